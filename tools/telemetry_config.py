"""How telemetry is done: what is published where and how often, and what may be asked for."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from preshape.tools.telemetry_keys import ROBOT
from preshape.tools.telemetry_states import STATES

ENDPOINT = "tcp/127.0.0.1:7447"
"""Where telemetry listens when nothing else is said: this machine only."""

Rate = Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]
ServiceName = Literal["arm", "goal", "start"]


class TelemetryConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is published where and how often, and which services move things.

    Attributes:
        robot: the id that every key begins with, after `preshape/`.
        endpoint: where to listen, as Zenoh writes it; not used when there is a `zenoh_config`.
        zenoh_config: a Zenoh configuration file (JSON5, JSON or YAML), passed on as it is.
        joints_hz, object_hz, task_hz: messages a second of the loop's clock, of each key; at most one a tick.
        health_hz: messages a second of the machine's clock, of each part.
        heartbeat_hz: the same of heartbeats: three missing ones mean a stopped process.
        events_kept: how many events somebody who comes late can ask for.
        services: what may be asked for besides status, parameters and stop. With `start` among them a run waits for
            it, and with `arm` for that before.
    """

    robot: str = ROBOT
    endpoint: str = ENDPOINT
    zenoh_config: str | None = None
    joints_hz: Rate = 50.0
    object_hz: Rate = 50.0
    task_hz: Rate = 20.0
    health_hz: Annotated[float, msgspec.Meta(gt=0.0, le=50.0)] = 2.0
    heartbeat_hz: Annotated[float, msgspec.Meta(ge=10.0, le=50.0)] = 12.0
    events_kept: Annotated[int, msgspec.Meta(ge=1, le=100_000)] = 1000
    services: tuple[ServiceName, ...] = ()

    def rates(self) -> dict[str, float]:
        """Return the messages a second of every state key."""
        named = {"state/object": self.object_hz, "state/task": self.task_hz}
        return {tail: named.get(tail, self.joints_hz) for tail in STATES}
