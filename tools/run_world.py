"""The world of one run, in lockstep or paced: what the loop drives, and what only the report may see."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from preshape.hal.clock import Clock
from preshape.hal.device import Device
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import Opening, Perception
from preshape.sim_backend.lockstep import LockstepWorld, open_lockstep
from preshape.sim_backend.paced import PacedWorld
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene_port import ScenePlace
from preshape.tools.can_setup import can_setup
from preshape.tools.can_world import open_lockstep_can, open_paced_can, require_buses
from preshape.tools.remote_world import open_served_world
from preshape.tools.run_ended import Ended
from preshape.tools.run_options import RunOptions
from preshape.tools.wire_watch import WireWatch


class RunWorld(Protocol):
    """One world, open and at rest. Only `device`, `clock` and `perception` are for the controller."""

    device: Device
    clock: Clock
    perception: Perception

    def report_opening(self, opening: Opening, X_world_box: Matrix) -> None:
        """Tell the referee what has been found, and where the controller takes the box to be."""
        ...

    def scene_positions(self) -> Vector:
        """Return the positions (nq,) of everything in the scene, for pictures; may be overwritten later."""
        ...

    def finish(self) -> Ended:
        """End the run; nothing else may be asked afterwards."""
        ...


class LockstepRun:
    """`RunWorld` in this process."""

    def __init__(self, world: LockstepWorld) -> None:
        """Take over a lockstep world, whatever its device."""
        self._world = world
        self.device: Device = world.device
        self.clock: Clock = world.clock
        self.perception: Perception = world.perception

    def report_opening(self, opening: Opening, X_world_box: Matrix) -> None:
        """Tell the referee what has been found."""
        self._world.referee.report_opening(opening.face, opening.edge, opening.offset, X_world_box)

    def scene_positions(self) -> Vector:
        """Return the scene's positions (nq,)."""
        return self._world.simulation.data.qpos

    def finish(self) -> Ended:
        """Return the verdict."""
        world = self._world
        return Ended(world.referee.verdict(), world.simulation.seconds, kicks=tuple(world.kicks.given))


class PacedRun:
    """`RunWorld` whose physics and camera are processes of their own."""

    def __init__(self, world: PacedWorld) -> None:
        """Take over the processes of a paced world."""
        self._world = world
        self.device: Device = world.device
        self.clock: Clock = world.clock
        self.perception: Perception = world.perception

    def report_opening(self, opening: Opening, X_world_box: Matrix) -> None:
        """Tell the referee what has been found."""
        self._world.referee.report_opening(opening.face, opening.edge, opening.offset, X_world_box)

    def scene_positions(self) -> Vector:
        """Return the scene's positions (nq,) as last published."""
        return self._world.device.scene_positions

    def finish(self) -> Ended:
        """End the processes and return the verdict."""
        ended = self._world.finish()
        return Ended(ended.verdict, ended.simulated_s, ended.slipped_s, ended.kicks)


def require_reachable(options: RunOptions) -> None:
    """Refuse what a run in real time needs and cannot reach, before anything that takes long.

    Raises:
        ConfigurationError: the buses asked for cannot be.
        DeviceUnreachable: a bus cannot be opened, or no hand bus is where the run is to find one.
    """
    if options.device == "can":
        setup = can_setup(options)
        require_buses(setup)
        if options.attach:
            ScenePlace(setup.addresses).connect().close()


@contextmanager
def open_world(
    drawn: Scenario, options: RunOptions, bus_log: Path | None = None, wire: WireWatch | None = None
) -> Generator[RunWorld]:
    """Give the world of a drawn scenario, as the options ask for it, with its device open; leaving ends it.

    `bus_log` is the file that the frames of a CAN world's buses are written to (in real time the driver's); `wire`
    listens to them, and lets go wrong what has been asked for.

    Raises:
        ConfigurationError: the buses asked for cannot be.
        DeviceUnreachable: a bus or a process of the world did not come up, or has died.
    """
    period_s = 1.0 / options.loop_rate_hz
    if options.device == "can":
        setup = can_setup(options)
        if options.in_real_time:
            with open_paced_can(drawn, options, setup, bus_log) as world:
                yield world
        else:
            with open_lockstep_can(drawn, setup, bus_log, wire) as can_lockstep:
                run = LockstepRun(can_lockstep.world)
                if wire is not None:
                    run.clock = wire.over(run.clock, can_lockstep.rack)
                yield run
    elif options.device == "zenoh":
        with open_served_world(drawn, options) as world:
            yield world
    elif options.in_real_time:
        with PacedWorld(drawn, options.patience, period_s, options.pace) as processes:
            processes.device.open()
            yield PacedRun(processes)
    else:
        lockstep = open_lockstep(drawn, period_s=period_s)
        lockstep.device.open()
        yield LockstepRun(lockstep)
