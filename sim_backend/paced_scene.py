"""A scene in real time whose joints hang on CAN buses: all that the controller's process holds of it but its device."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np

from preshape.hal.clock import MonotonicClock
from preshape.hal.device import DeviceUnreachable
from preshape.hal.state import Vector
from preshape.sim_backend.bus_joints import BusWiring
from preshape.sim_backend.paced import Line, PacedPerception, PacedReferee, end_children
from preshape.sim_backend.paced_camera import run_camera
from preshape.sim_backend.paced_layout import PHYSICS, Describe, Described, Finish, Finished, state_record
from preshape.sim_backend.paced_physics import run_bus_physics
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import build_scene, camera_model
from preshape.sim_backend.scene_port import ScenePlace
from preshape.sim_backend.shared_block import Memory, SharedBlock, file_bytes, shared_bytes


class PacedScene:
    """The scene of a run on buses, physics and camera in other processes.

    A context manager: `finish` inside it for the verdict; leaving ends the processes that were started for it.
    """

    def __init__(self, scenario: Scenario, wiring: BusWiring | ScenePlace) -> None:
        """Start a drawn scenario's physics with modules on buses, or go to where a hand bus simulates it already.

        Raises:
            DeviceUnreachable: a process did not come up, nobody is there, or another world is simulated there.
        """
        self._context = multiprocessing.get_context("spawn")
        self._children: list[BaseProcess] = []
        self._record = state_record(build_scene(scenario))
        try:
            if isinstance(wiring, BusWiring):
                self._physics, memory, source = self._begin(scenario, wiring)
                pace = wiring.pace
            else:
                self._physics, memory, source, pace = self._join(scenario, wiring)
            lens = camera_model(scenario)
            pixels = self._context.RawArray("c", lens.width * lens.height)
            camera = self._start("camera", run_camera, (scenario,), (source, pixels))
            camera.expect_ready()
        except DeviceUnreachable:
            end_children(self._children)
            raise
        self.clock = MonotonicClock(pace)
        self._camera = camera
        self._state = SharedBlock(memory, self._record)
        block, image = SharedBlock(memory, self._record), np.frombuffer(memoryview(pixels), np.uint8)
        self.perception = PacedPerception(scenario, block, camera, image)
        self.referee = PacedReferee(self._physics)
        self._positions = np.zeros(self._record["qpos"].shape)

    def scene_positions(self) -> Vector:
        """Return the positions (nq,) of everything in the scene as last published: for pictures, not for control."""
        record = self._state.read()
        if record is not None:
            self._positions = record[0]["qpos"]
        return self._positions

    def finish(self) -> Finished:
        """End the run and return the referee's verdict; `DeviceUnreachable` if the physics has died."""
        finished: Finished = self._physics.ask(Finish())
        self.close()
        return finished

    def close(self) -> None:
        """End the processes that were started for this scene; may be called twice."""
        self._camera.tell(None)
        if len(self._children) > 1:
            self._physics.tell(Finish())
        end_children(self._children)

    def __enter__(self) -> PacedScene:
        return self

    def __exit__(self, *cause: object) -> None:
        self.close()

    def _begin(self, scenario: Scenario, wiring: BusWiring) -> tuple[Line, Memory, Memory]:
        memory = shared_bytes(self._context, self._record)
        line = self._start(PHYSICS, run_bus_physics, (scenario, wiring), (memory,))
        line.expect_ready()
        return line, memory, memory

    def _join(self, scenario: Scenario, place: ScenePlace) -> tuple[Line, Memory, Path, float]:
        line = Line(place.connect(), "hand-bus")
        described: Described = line.ask(Describe())
        there = described.scenario
        if there != scenario:
            raise DeviceUnreachable(
                f"the hand bus simulates {there.name} with seed {there.seed}, the run asks for {scenario.name} "
                f"with seed {scenario.seed}: give both the same --scenario, --seed and --set"
            )
        return line, file_bytes(place.state, self._record), place.state, described.pace

    def _start(self, name: str, target: Callable[..., None], before: tuple[Any, ...], after: tuple[Any, ...]) -> Line:
        here, there = self._context.Pipe()
        child = self._context.Process(name=name, target=target, args=(*before, there, *after), daemon=True)
        child.start()
        # Only the child keeps its end: when it dies, this one reads the end of the line.
        there.close()
        self._children.append(child)
        return Line(here, name)
