"""Physics in real time in a process of its own: what the controller's process holds of it."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from preshape.hal.clock import MonotonicClock
from preshape.hal.device import DeviceUnreachable
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, RobotCommand, RobotState, Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import Face, Image, OrientedBox, PoseSample
from preshape.sim_backend.device import COMMAND_PERIOD_S, WATCHDOG_CYCLES, is_finite
from preshape.sim_backend.paced_camera import run_camera
from preshape.sim_backend.paced_layout import (
    COMMAND,
    PHYSICS,
    Arm,
    Close,
    Finish,
    Finished,
    FreezeTorque,
    Open,
    ReportOpening,
    Request,
    Stop,
    state_record,
)
from preshape.sim_backend.paced_physics import run_physics
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import build_scene, camera_model
from preshape.sim_backend.sensors import SceneSensors
from preshape.sim_backend.shared_block import Record, SharedBlock, shared_bytes

START_S = 180.0
"""Longest time that both processes may take to be ready, s."""
ANSWER_S = 5.0


class Line:
    """Requests to one other process: at most one question under way, from any thread."""

    def __init__(self, connection: Connection, name: str) -> None:
        """Talk over a connection to a process of a name."""
        self._connection, self._name = connection, name
        self._lock = Lock()

    def tell(self, request: object) -> None:
        """Send without waiting for an answer; a child that is gone is told nothing."""
        with self._lock:
            try:
                self._connection.send(request)
            except OSError:
                return

    def ask(self, request: object, within_s: float = ANSWER_S) -> Any:
        """Send and return the answer; `DeviceUnreachable` if none comes in time."""
        with self._lock:
            try:
                self._connection.send(request)
                return self._receive(within_s)
            except (OSError, EOFError) as gone:
                raise DeviceUnreachable(f"{self._name} process has ended") from gone

    def expect_ready(self) -> None:
        """Wait for the child's first word."""
        try:
            self._receive(START_S)
        except (OSError, EOFError) as gone:
            raise DeviceUnreachable(f"{self._name} process ended before it was ready") from gone

    def _receive(self, within_s: float) -> Any:
        if not self._connection.poll(within_s):
            raise DeviceUnreachable(f"{self._name} process: no answer within {within_s:g} s")
        return self._connection.recv()


class PacedDevice:
    """`preshape.hal.device.Device` whose joints move in the physics process; `read` and `write` never wait."""

    def __init__(self, line: Line, state: SharedBlock, command: SharedBlock) -> None:
        """Talk to the physics process over its line and its two blocks of shared memory."""
        self._line, self._state, self._command = line, state, command
        self._armed = False
        self._sequence = -1
        self._last: Record = np.zeros(1, state.record.dtype)

    def open(self) -> None:
        """Connect; nothing moves."""
        self._line.ask(Open())
        self._sequence = -1

    @property
    def scene_positions(self) -> Vector:
        """Positions (nq,) of everything in the scene at the last `read`: for pictures, not for control."""
        return self._last[0]["qpos"]

    def read(self, now_ns: int) -> RobotState:
        """Return the newest published sample."""
        record = self._newest()[0]
        stamp_ns = np.full(LAYOUT.dof, record["stamp_ns"], dtype=np.int64)
        return RobotState(
            int(record["sequence"]),
            record["position"],
            record["velocity"],
            record["torque"],
            stamp_ns,
            DeviceStatus(int(record["status"])),
            bytes(record["fault"]).decode("ascii"),
        )

    def arm(self, now_ns: int) -> None:
        """Hold the measured position and take commands from now on."""
        cause: str = self._line.ask(Arm())
        if cause:
            raise RuntimeError(cause)
        self._newest()
        self._armed = True

    def write(self, command: RobotCommand, now_ns: int) -> bool:
        """Hand a command over if armed, newer than the last and finite; it is taken at the next physics step."""
        if not self._armed or command.sequence <= self._sequence or not is_finite(command):
            return False
        if int(self._last[0]["status"]) != DeviceStatus.ARMED:
            self._armed = False
            return False
        self._sequence = command.sequence
        out = self._command.record[0]
        out["sequence"], out["mode"] = command.sequence, int(command.mode)
        out["position"], out["torque_limit"], out["torque"] = command.position, command.torque_limit, command.torque
        self._command.publish()
        return True

    def stop(self, reason: str, now_ns: int) -> None:
        """Latch STOPPED; the physics takes it at its next step, before any command."""
        self._armed = False
        self._line.tell(Stop(reason))

    def close(self) -> None:
        """Disconnect; the joints hold their position. Harmless after the processes have ended."""
        self._armed = False
        try:
            self._line.ask(Close())
        except DeviceUnreachable:
            return

    def _newest(self) -> Record:
        record = self._state.read()
        if record is not None:
            self._last = record
        return self._last


class PacedPerception:
    """`preshape.hal.world.Perception` over the two processes; `image` blocks its thread, not the physics."""

    def __init__(self, scenario: Scenario, state: SharedBlock, camera: Line, pixels: NDArray[np.uint8]) -> None:
        """Read poses from the physics' block and images from the camera process."""
        self._state, self._camera, self._pixels = state, camera, pixels
        self._lens = camera_model(scenario)
        self._appeared_s = np.full(len(scenario.obstacles), np.nan)
        self._sensors = SceneSensors(scenario, self._lens, _no_image, self._appeared_s)

    def object_pose(self, now_ns: int) -> PoseSample | None:
        """Return the newest pose sample that has arrived."""
        record = self._state.read()
        if record is None or record[0]["pose_stamp_ns"] < 0:
            return None
        return PoseSample(int(record[0]["pose_stamp_ns"]), record[0]["X_world_box"].copy())

    def obstacles(self, now_ns: int) -> tuple[OrientedBox, ...]:
        """Return the obstacles as they were one delay ago."""
        record = self._state.read()
        if record is None:
            return ()
        self._appeared_s[:] = record[0]["appeared_s"][: len(self._appeared_s)]
        return self._sensors.obstacles(int(record[0]["scene_ns"]))

    def image(self, now_ns: int) -> Image:
        """Take an image, read out around where the last pose sample puts the box."""
        sample = self.object_pose(now_ns)
        taken_ns: int = self._camera.ask((None if sample is None else sample.X_world_box,))
        if not taken_ns:
            raise DeviceUnreachable("camera process: the physics publishes too fast to be read")
        shape = self._lens.height, self._lens.width
        return Image(taken_ns, self._pixels.reshape(shape).copy(), self._lens)


class PacedReferee:
    """The way to the referee, who sits in the physics process."""

    def __init__(self, line: Line) -> None:
        """Talk to the physics process over its line."""
        self._line = line

    def report_opening(self, face: Face, edge: Face, offset: float, X_world_box: Matrix) -> None:
        """Tell the referee the opening that was found, without waiting."""
        self._line.tell(ReportOpening(face, edge, offset, np.array(X_world_box)))


class PacedWorld:
    """Both processes of a paced run. A context manager: `finish` inside it for the verdict; leaving ends them."""

    def __init__(
        self,
        scenario: Scenario,
        watchdog_cycles: int = WATCHDOG_CYCLES,
        period_s: float = COMMAND_PERIOD_S,
        pace: float = 1.0,
    ) -> None:
        """Start the physics and the camera of a drawn scenario and wait until both are ready.

        `period_s` is the time between two commands; `pace` seconds of the scene pass in each of the machine's.

        Raises:
            DeviceUnreachable: a process did not come up.
        """
        context = multiprocessing.get_context("spawn")
        record = state_record(build_scene(scenario))
        lens = camera_model(scenario)
        state, command = shared_bytes(context, record), shared_bytes(context, COMMAND)
        pixels = context.RawArray("c", lens.width * lens.height)
        self._children: list[BaseProcess] = []

        def start(name: str, target: Callable[..., None], before: tuple[Any, ...], after: tuple[Any, ...]) -> Line:
            here, there = context.Pipe()
            child = context.Process(name=name, target=target, args=(scenario, *before, there, *after), daemon=True)
            child.start()
            # Only the child keeps its end: when it dies, this one reads the end of the line.
            there.close()
            self._children.append(child)
            return Line(here, name)

        self._physics = start(PHYSICS, run_physics, (watchdog_cycles, period_s, pace), (state, command))
        self._camera = start("camera", run_camera, (), (state, pixels))
        try:
            self._physics.expect_ready()
            self._camera.expect_ready()
        except DeviceUnreachable:
            self.close()
            raise
        self.clock = MonotonicClock(pace)
        self.device = PacedDevice(self._physics, SharedBlock(state, record), SharedBlock(command, COMMAND))
        self.perception = PacedPerception(
            scenario, SharedBlock(state, record), self._camera, np.frombuffer(memoryview(pixels), np.uint8)
        )
        self.referee = PacedReferee(self._physics)

    def freeze_torque(self, joints: slice) -> None:
        """Break the torque sensors of some joints, by their place in the layout."""
        self._physics.tell(FreezeTorque(joints.start, joints.stop))

    def finish(self) -> Finished:
        """End the run and return the referee's verdict; `DeviceUnreachable` if the physics process has died."""
        finished: Finished = self._physics.ask(Finish())
        self.close()
        return finished

    def close(self) -> None:
        """End both processes; may be called twice."""
        ask_to_end: tuple[tuple[Line, Request | None], ...] = ((self._physics, Finish()), (self._camera, None))
        for line, word in ask_to_end:
            line.tell(word)
        end_children(self._children)

    def __enter__(self) -> PacedWorld:
        return self

    def __exit__(self, *cause: object) -> None:
        self.close()


def end_children(children: Sequence[BaseProcess]) -> None:
    """Wait for processes that have been asked to end, and kill those that do not."""
    for child in children:
        child.join(ANSWER_S)
        if child.is_alive():
            child.kill()
            child.join()


def _no_image(X_world_box: Matrix | None) -> NDArray[np.uint8]:
    raise DeviceUnreachable("images come from the camera process")
