"""The world of one run, in lockstep or paced: what the loop drives, and what only the report may see."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from preshape.hal.clock import Clock
from preshape.hal.device import Device
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import Opening, Perception
from preshape.sim_backend.lockstep import LockstepWorld, open_lockstep
from preshape.sim_backend.paced import PacedWorld
from preshape.sim_backend.referee_report import Verdict
from preshape.sim_backend.scenario import Scenario


@dataclass(frozen=True, slots=True, eq=False)
class Ended:
    """What the world's side knows when a run is over.

    `slipped_s`: time by which a paced scene stood still because the machine did not run it; `kicks`: each
    disturbance given, (task, s).
    """

    verdict: Verdict
    simulated_s: float
    slipped_s: float = 0.0
    kicks: tuple[tuple[int, float], ...] = ()


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


class _Lockstep:
    """`RunWorld` in this process."""

    def __init__(self, world: LockstepWorld) -> None:
        self._world = world
        self.device: Device = world.device
        self.clock: Clock = world.clock
        self.perception: Perception = world.perception

    def report_opening(self, opening: Opening, X_world_box: Matrix) -> None:
        self._world.referee.report_opening(opening.face, opening.edge, opening.offset, X_world_box)

    def scene_positions(self) -> Vector:
        return self._world.simulation.data.qpos

    def finish(self) -> Ended:
        world = self._world
        return Ended(world.referee.verdict(), world.simulation.seconds, kicks=tuple(world.kicks.given))


class _Paced:
    """`RunWorld` whose physics and camera are processes of their own."""

    def __init__(self, world: PacedWorld) -> None:
        self._world = world
        self.device: Device = world.device
        self.clock: Clock = world.clock
        self.perception: Perception = world.perception

    def report_opening(self, opening: Opening, X_world_box: Matrix) -> None:
        self._world.referee.report_opening(opening.face, opening.edge, opening.offset, X_world_box)

    def scene_positions(self) -> Vector:
        return self._world.device.scene_positions

    def finish(self) -> Ended:
        ended = self._world.finish()
        return Ended(ended.verdict, ended.simulated_s, ended.slipped_s, ended.kicks)


@contextmanager
def open_world(drawn: Scenario, paced: bool) -> Generator[RunWorld]:
    """Give the world of a drawn scenario with its device open; leaving ends it.

    Raises:
        DeviceUnreachable: a process of a paced world did not come up, or has died.
    """
    if not paced:
        world = _Lockstep(open_lockstep(drawn))
        world.device.open()
        yield world
        return
    with PacedWorld(drawn) as processes:
        processes.device.open()
        yield _Paced(processes)
