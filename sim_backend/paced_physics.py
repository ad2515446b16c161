"""The physics process of a paced run: steps in real time, publishes the scene, keeps the referee.

Behind it the joints are driven from shared memory, or by joint modules on CAN buses.
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Protocol

import numpy as np

from preshape.hal.kernel_warm_up import remember_signatures, warm_up
from preshape.sim_backend.bus_joints import BusJoints, BusWiring
from preshape.sim_backend.kicks import KickSchedule
from preshape.sim_backend.paced_layout import (
    Describe,
    Described,
    Finish,
    Finished,
    FreezeTorque,
    ReportOpening,
    state_record,
)
from preshape.sim_backend.real_pace import RealPace
from preshape.sim_backend.referee import Referee
from preshape.sim_backend.referee_report import Verdict
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene_perception import attach_sensors
from preshape.sim_backend.shared_block import Memory, Record, SharedBlock
from preshape.sim_backend.shared_joints import SharedJoints
from preshape.sim_backend.simulation import Simulation

PRIORITY = 20


class RequestPort(Protocol):
    """Where requests come from and answers go to."""

    def poll(self) -> bool:
        """Return whether a request, or the end of the line, is there."""
        ...

    def recv(self) -> object:
        """Return the next request; `EOFError` when there will be none any more."""
        ...

    def send(self, obj: object, /) -> None:
        """Answer."""
        ...


class Joints(Protocol):
    """Who drives the joints of the scene."""

    def take(self) -> None:
        """Take what has been commanded, before a step."""
        ...

    def fill(self, out: Record) -> None:
        """Write what is known of the joints into the record that is published."""
        ...

    def answer(self, request: object) -> str | None:
        """Do what a request asks of the joints; return the answer, None for no answer."""
        ...

    def close(self) -> None:
        """Let go of the joints."""
        ...


def run_physics(
    scenario: Scenario,
    watchdog_cycles: int,
    period_s: float,
    pace: float,
    requests: Connection,
    state_memory: ctypes.Array[ctypes.c_char],
    command_memory: ctypes.Array[ctypes.c_char],
) -> None:
    """Run until `Finish`, or until the other end of `requests` is gone."""
    # Ctrl-C reaches every process of a terminal: how the run ends is the controller's to say.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    simulation = Simulation(scenario)
    physics = PacedPhysics(simulation, requests, state_memory, pace)
    joints = SharedJoints(simulation, period_s, watchdog_cycles, command_memory, physics.publish)
    run_with_priority(physics, joints)


def run_bus_physics(
    scenario: Scenario,
    wiring: BusWiring,
    requests: Connection,
    state_memory: ctypes.Array[ctypes.c_char],
) -> None:
    """Run the scene with joint modules on buses until `Finish`, or until the other end of `requests` is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    simulation = Simulation(scenario)
    physics = PacedPhysics(simulation, requests, state_memory, wiring.pace)
    joints = BusJoints(simulation, wiring)
    run_with_priority(physics, joints)


def run_with_priority(physics: PacedPhysics, joints: Joints) -> None:
    """Run a scene with its kernels ready, before the machine's other work if it lets us."""
    warm_up()
    take_priority()
    physics.run(joints)
    remember_signatures()


def take_priority() -> None:
    """Run before the machine's other work, if it lets us, and without collecting what lives as long as the process.

    On a machine of one core a scene that is always late would let nobody else run, so there it takes its turn.
    """
    gc.collect()
    gc.freeze()
    if len(os.sched_getaffinity(0)) == 1:
        return
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


class PacedPhysics:
    """The loop and all it owns; scene times count from 0, stamps are put on the monotonic clock when published."""

    def __init__(self, simulation: Simulation, requests: RequestPort, state_memory: Memory, pace: float = 1.0) -> None:
        """Look after a simulation; requests come by `requests`, the scene is published into `state_memory`.

        `pace` seconds of the scene pass in each of the machine's.
        """
        self._simulation = simulation
        self._referee = Referee(simulation)
        self._sensors = attach_sensors(simulation)
        self._kicks = KickSchedule(simulation, self._referee)
        self._requests = requests
        self._state = SharedBlock(state_memory, state_record(simulation.model))
        self.pace = pace
        self._pace = RealPace(pace)
        self._joints: Joints | None = None
        self._running = True

    def run(self, joints: Joints) -> None:
        """Step in real time until the end is asked for."""
        self._joints = joints
        self.publish()
        self._pace.begin(self._simulation.time_ns)
        self.publish()
        self._requests.send("ready")
        try:
            while self._running:
                self._serve(joints)
                joints.take()
                self._simulation.step()
                self.publish()
                self._pace.wait(self._simulation.time_ns)
        finally:
            joints.close()

    def verdict(self) -> Verdict:
        """Return what the referee says of the scene so far."""
        return self._referee.verdict()

    def end(self) -> None:
        """Make `run` return after the present step."""
        self._running = False

    def publish(self) -> None:
        """Publish the scene as it is."""
        simulation, out, offset_ns = self._simulation, self._state.record[0], self._pace.offset_ns
        sample = self._sensors.object_pose(simulation.time_ns)
        out["scene_ns"] = simulation.time_ns
        out["now_ns"] = simulation.time_ns + offset_ns
        if self._joints is not None:
            self._joints.fill(out)
            out["stamp_ns"] = simulation.sample_ns + offset_ns
        out["pose_stamp_ns"] = -1 if sample is None else sample.stamp_ns + offset_ns
        out["X_world_box"] = np.eye(4) if sample is None else sample.X_world_box
        out["qpos"] = simulation.data.qpos
        out["mocap_pos"][: simulation.model.nmocap] = simulation.data.mocap_pos
        out["appeared_s"][: simulation.model.nmocap] = simulation.obstacles.appeared_s
        self._state.publish()

    def _serve(self, joints: Joints) -> None:
        while self._running and self._requests.poll():
            try:
                request = self._requests.recv()
            except EOFError:
                self._running = False
                return
            self._answer(request, joints)

    def _answer(self, request: object, joints: Joints) -> None:
        match request:
            case Describe():
                self._requests.send(Described(self._simulation.scenario, self.pace))
            case ReportOpening(face, edge, offset, X_world_box):
                self._referee.report_opening(face, edge, offset, X_world_box)
            case FreezeTorque(first, last):
                self._simulation.joint_sensors.freeze_torque(slice(first, last))
            case Finish():
                self._running = False
                self._requests.send(self._finished())
            case _:
                answer = joints.answer(request)
                if answer is not None:
                    self._requests.send(answer)

    def _finished(self) -> Finished:
        kicks = tuple(self._kicks.given)
        pace = self._pace
        return Finished(self.verdict(), self._simulation.seconds, pace.slipped_ns * 1e-9, pace.slips, kicks)
