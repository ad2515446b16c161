"""Zenoh sessions as this project opens them: explicit endpoints, no scouting, nothing beyond this machine unasked."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from preshape.hal.device import DeviceUnreachable
from preshape.tools.configuration_error import ConfigurationError

if TYPE_CHECKING:
    import zenoh

SPOKEN = ("put", "delete", "declare_queryable", "reply", "liveliness_token")
"""What only a robot may say about itself."""

_QUIET: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "timestamping/enabled": False,
    # Its segments outlive a process that is killed.
    "transport/shared_memory/enabled": False,
}
_PRIORITIES = (
    "control", "real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background",
)  # fmt: skip
QUEUE = 16
"""Messages on their way to one subscriber, per priority: all streams of several ticks."""
DROP_US = 5_000
"""How long a state message waits for a full queue before it is dropped for that subscriber, us."""
BLOCK_US = 200_000
"""How long an event waits for one subscriber that takes nothing before its connection is closed, us."""
_NOBODY_THERE = "start what is to be found there: `preshape serve`, or `preshape run --telemetry`"
_IN_ZENOH = re.compile(r" at \S+\.rs:\d+\.?")


def robot_settings(endpoint: str, spoken: Sequence[str]) -> dict[str, Any]:
    """Return the settings of a robot's own session: others may listen and ask, and not speak under its keys.

    `spoken` are the key expressions that are the robot's.
    """
    rule = {
        "id": "speak",
        "messages": list(SPOKEN),
        "flows": ["ingress"],
        "permission": "deny",
        "key_exprs": list(spoken),
    }
    return {
        "mode": "peer",
        "listen/endpoints": [endpoint],
        "connect/endpoints": [],
        **_QUIET,
        "transport/link/tx/queue/size": dict.fromkeys(_PRIORITIES, QUEUE),
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": DROP_US,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": BLOCK_US,
        "access_control": {
            "enabled": True,
            "default_permission": "allow",
            "rules": [rule],
            "subjects": [{"id": "anybody"}],
            "policies": [{"rules": ["speak"], "subjects": ["anybody"]}],
        },
    }


def client_settings(endpoint: str) -> dict[str, Any]:
    """Return the settings of a session that connects to a robot."""
    return {"mode": "client", "listen/endpoints": [], "connect/endpoints": [endpoint], **_QUIET,
            "connect/timeout_ms": 2000}  # fmt: skip


def open_session(settings: Mapping[str, Any], file: str | Path | None = None) -> zenoh.Session:
    """Open a session with settings, or with a configuration file in their stead, as it is.

    Raises:
        ConfigurationError: the file or a setting is not what Zenoh understands.
        DeviceUnreachable: nobody listens at an endpoint, or it cannot be listened at.
    """
    import zenoh

    try:
        config = zenoh.Config() if file is None else zenoh.Config.from_file(file)
        if file is None:
            for key, value in settings.items():
                config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise ConfigurationError(f"Zenoh configuration {file or dict(settings)}: {_first_line(error)}") from error
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = file or ", ".join([*settings["listen/endpoints"], *settings["connect/endpoints"]])
        hint = "" if file or not settings["connect/endpoints"] else f"; {_NOBODY_THERE}"
        raise DeviceUnreachable(f"Zenoh session at {where}: {_first_line(error)}{hint}") from error


def _first_line(error: Exception) -> str:
    """Return an error's first line without the place in Zenoh's own sources."""
    return _IN_ZENOH.sub("", str(error).partition("\n")[0]).rstrip(".!")
