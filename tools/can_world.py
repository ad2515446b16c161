"""Worlds whose joints hang on CAN buses: in lockstep with everything in this process, or in real time with others."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import can

from preshape.hal.can.await_modules import await_modules
from preshape.hal.can.bus_address import open_bus, open_buses
from preshape.hal.can.device import CanDevice
from preshape.hal.can.topology import BusSpec
from preshape.hal.clock import Clock
from preshape.hal.device import Device
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import Opening, Perception
from preshape.sim_backend.bus_joints import BusWiring
from preshape.sim_backend.can_lockstep import CanLockstepWorld, open_can_lockstep
from preshape.sim_backend.paced_scene import PacedScene
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene_port import ScenePlace
from preshape.tools.bus_recorder import BusRecorder
from preshape.tools.can_setup import CanSetup
from preshape.tools.run_ended import Ended
from preshape.tools.run_options import RunOptions
from preshape.tools.wire_watch import WireWatch

MODULES_S = 5.0
"""Longest time until every module on the buses has answered, s."""


def require_buses(setup: CanSetup) -> None:
    """Refuse buses that cannot be opened, before anything that takes long; `DeviceUnreachable` in one line."""
    for bus in open_buses(setup.topology, setup.addresses).values():
        bus.shutdown()


@contextmanager
def open_lockstep_can(
    drawn: Scenario, setup: CanSetup, bus_log: Path | None, wire: WireWatch | None
) -> Generator[CanLockstepWorld]:
    """Give a world on virtual buses; their frames go to the file `bus_log`, if there is one, and to `wire`."""
    wrap, listeners = (None, ()) if wire is None else (wire.wrap, (wire.hear,))
    world = open_can_lockstep(drawn, setup.config, setup.topology, bus_log, module_side=wrap, listeners=listeners)
    try:
        yield world
    finally:
        world.close()


class PacedCanRun:
    """`RunWorld` on buses in real time: the driver here, modules and physics elsewhere."""

    def __init__(self, scene: PacedScene, driver: CanDevice) -> None:
        """Take over a scene and an open driver."""
        self._scene = scene
        self.device: Device = driver
        self.clock: Clock = scene.clock
        self.perception: Perception = scene.perception

    def report_opening(self, opening: Opening, X_world_box: Matrix) -> None:
        """Tell the referee what has been found."""
        self._scene.referee.report_opening(opening.face, opening.edge, opening.offset, X_world_box)

    def scene_positions(self) -> Vector:
        """Return the scene's positions (nq,) as last published."""
        return self._scene.scene_positions()

    def finish(self) -> Ended:
        """Stop the modules, end the processes started for the run, and return the verdict."""
        self.device.close()
        ended = self._scene.finish()
        return Ended(ended.verdict, ended.simulated_s, ended.slipped_s, ended.kicks)


@contextmanager
def open_paced_can(
    drawn: Scenario, options: RunOptions, setup: CanSetup, bus_log: Path | None = None
) -> Generator[PacedCanRun]:
    """Give a world on buses in real time, with physics started for it or those of a running hand bus.

    What the driver sends and receives goes to the file `bus_log`, if there is one.
    """
    addresses = setup.addresses
    wiring = BusWiring(setup.topology, addresses, options.patience, options.pace)
    place = ScenePlace(addresses) if options.attach else wiring
    logged = nullcontext() if bus_log is None else BusRecorder(bus_log, [spec.name for spec in setup.topology.buses])
    with logged as log, PacedScene(drawn, place) as scene:

        def open_one(spec: BusSpec, identifiers: list[int]) -> can.BusABC:
            bus = open_bus(addresses[spec.name], spec.profile, identifiers)
            return bus if log is None else log.over(spec.name, bus, addresses[spec.name].echoes)

        driver = CanDevice(setup.topology, open_one, setup.config)
        try:
            driver.open()
            await_modules(driver, scene.clock, MODULES_S)
            yield PacedCanRun(scene, driver)
        finally:
            driver.close()
