"""The world of a run whose device, sensors and referee are served by another process."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import msgspec
import numpy as np

from preshape.hal.clock import Clock, MonotonicClock
from preshape.hal.device import Device, DeviceUnreachable
from preshape.hal.remote_calls import DEVICE_KEY
from preshape.hal.remote_device import RemoteDevice
from preshape.hal.remote_line import RemoteLine
from preshape.hal.remote_perception import RemotePerception
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import Opening, Perception
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import camera_model
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.real_time import real_time
from preshape.tools.run_ended import Ended
from preshape.tools.run_options import RunOptions
from preshape.tools.served_opening import opening_to
from preshape.tools.telemetry_keys import Keys
from preshape.tools.zenoh_session import client_settings, open_session


class RemoteWorld:
    """`preshape.tools.run_world.RunWorld` behind a line to a server."""

    def __init__(self, line: RemoteLine, drawn: Scenario) -> None:
        """Take the line; the device is not yet open."""
        self._line = line
        self.remote = RemoteDevice(line)
        self.device: Device = self.remote
        self.clock: Clock = MonotonicClock()
        self.perception: Perception = RemotePerception(line, camera_model(drawn))

    def report_opening(self, opening: Opening, X_world_box: Matrix) -> None:
        """Tell the referee what has been found, without waiting."""
        self._line.tell("opening", arguments=opening_to(opening, X_world_box))

    def scene_positions(self) -> Vector:
        """Return the newest positions (nq,) of everything in the scene."""
        payload = self._line.newest("scene")
        if payload is None:
            raise DeviceUnreachable("the served world has not sent its scene yet")
        return np.frombuffer(payload)

    def finish(self) -> Ended:
        """End the run and return the referee's verdict; `DeviceUnreachable` if the server has gone."""
        return msgspec.convert(self._line.ask("finish").world, Ended)


@contextmanager
def open_served_world(drawn: Scenario, options: RunOptions) -> Generator[RemoteWorld]:
    """Give the world that a server holds, its device open; leaving closes it.

    Raises:
        DeviceUnreachable: nobody serves there, or somebody else is using it.
        ConfigurationError: another world is served, or at another rate.
    """
    remote = options.remote
    root = Keys(remote.robot).of(DEVICE_KEY)
    # What Zenoh starts inherits the priority.
    with real_time():
        session = open_session(client_settings(remote.endpoint), remote.zenoh_config)
    with session:
        line = RemoteLine(session, root)
        world = RemoteWorld(line, drawn)
        try:
            world.remote.open()
            _check_world(world.remote.world, drawn, options.loop_rate_hz)
            yield world
        finally:
            world.remote.close()
            line.close()


def described(drawn: Scenario, rate_hz: int) -> dict[str, Any]:
    """Return a drawn scenario and the states and commands a second as JSON holds them."""
    return {"scenario": msgspec.json.decode(msgspec.json.encode(drawn)), "rate_hz": rate_hz}


def _check_world(served: dict[str, Any] | None, drawn: Scenario, rate_hz: int) -> None:
    """Compare the served world's description with this run's."""
    here, there = described(drawn, rate_hz), served or {}
    if here["scenario"] != there.get("scenario"):
        scenario = there.get("scenario", {"name": "none", "seed": "none"})
        raise ConfigurationError(
            f"--scenario, --seed: got {drawn.name} {drawn.seed}, served is {scenario['name']} {scenario['seed']} "
            "(or one with other fields): serve and run the same"
        )
    served_hz = there.get("rate_hz")
    if rate_hz != served_hz:
        raise ConfigurationError(f"--rate-hz: got {rate_hz}, served is {served_hz}: serve and run the same")
