"""The physics process of a paced run: steps in real time, takes commands, publishes samples, keeps the referee."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import time
from contextlib import suppress
from multiprocessing.connection import Connection

import numpy as np

from preshape.hal.kernel_warm_up import remember_signatures, warm_up
from preshape.hal.state import Mode, RobotCommand
from preshape.sim_backend.command_cadence import CommandCadence
from preshape.sim_backend.device import MujocoDevice
from preshape.sim_backend.kicks import KickSchedule
from preshape.sim_backend.paced_layout import (
    COMMAND,
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
from preshape.sim_backend.referee import Referee
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene_perception import attach_sensors
from preshape.sim_backend.shared_block import SharedBlock
from preshape.sim_backend.simulation import STEP_NS, Simulation

SLIP_NS = 3_000_000
"""Lateness from which on the scene stands still for that time instead of catching up in a burst, ns."""
YIELD_S = 1e-4
PRIORITY = 20


def run_physics(
    scenario: Scenario,
    watchdog_cycles: int,
    period_s: float,
    requests: Connection,
    state_memory: ctypes.Array[ctypes.c_char],
    command_memory: ctypes.Array[ctypes.c_char],
) -> None:
    """Run until `Finish`, or until the other end of `requests` is gone."""
    # Ctrl-C reaches every process of a terminal: how the run ends is the controller's to say.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    physics = _PacedPhysics(scenario, watchdog_cycles, period_s, requests, state_memory, command_memory)
    warm_up()
    gc.collect()
    gc.freeze()
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    physics.run()
    remember_signatures()


class _PacedPhysics:
    """The loop and all it owns; scene times count from 0, stamps are put on the monotonic clock when published."""

    def __init__(
        self,
        scenario: Scenario,
        watchdog_cycles: int,
        period_s: float,
        requests: Connection,
        state_memory: ctypes.Array[ctypes.c_char],
        command_memory: ctypes.Array[ctypes.c_char],
    ) -> None:
        self._simulation = Simulation(scenario)
        self._referee = Referee(self._simulation)
        self._sensors = attach_sensors(self._simulation)
        self._kicks = KickSchedule(self._simulation, self._referee)
        self._device = MujocoDevice(self._simulation, period_s, watchdog_cycles)
        self._requests = requests
        self._state = SharedBlock(state_memory, state_record(self._simulation.model))
        self._command = SharedBlock(command_memory, COMMAND)
        self._cadence = CommandCadence(max(1, round(period_s * 1e9 / STEP_NS)))
        self._taken = 0
        self._slipped_ns = self._slips = 0
        self._offset_ns = 0
        self._running = True

    def run(self) -> None:
        self._publish()
        self._offset_ns = time.monotonic_ns()
        self._publish()
        self._requests.send("ready")
        while self._running:
            self._serve()
            self._take_command()
            self._simulation.step()
            self._publish()
            self._wait()

    def _wait(self) -> None:
        """Sleep until the next step is due; after a stall of the machine let the scene stand still instead."""
        due_ns = self._offset_ns + self._simulation.time_ns + STEP_NS
        remaining_ns = due_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
        elif remaining_ns < -SLIP_NS:
            self._offset_ns -= remaining_ns
            self._slipped_ns -= remaining_ns
            self._slips += 1
            # A machine too slow for real time must still leave the processor to others.
            time.sleep(YIELD_S)

    def _serve(self) -> None:
        while self._running and self._requests.poll():
            try:
                request: Request = self._requests.recv()
            except EOFError:
                self._running = False
                return
            self._answer(request)

    def _answer(self, request: Request) -> None:
        now_ns = self._simulation.time_ns
        match request:
            case Open():
                self._device.open()
                self._reply("")
            case Arm():
                self._arm(now_ns)
            case Stop(reason):
                self._device.stop(reason, now_ns)
            case Close():
                self._device.close()
                self._reply("")
            case ReportOpening(face, edge, offset, X_world_box):
                self._referee.report_opening(face, edge, offset, X_world_box)
            case FreezeTorque(first, last):
                self._simulation.joint_sensors.freeze_torque(slice(first, last))
            case Finish():
                self._running = False
                kicks = tuple(self._kicks.given)
                seconds, slipped = self._simulation.seconds, self._slipped_ns * 1e-9
                self._requests.send(Finished(self._referee.verdict(), seconds, slipped, self._slips, kicks))

    def _reply(self, cause: str) -> None:
        """Answer once the published state shows what was done."""
        self._publish()
        self._requests.send(cause)

    def _arm(self, now_ns: int) -> None:
        self._taken = self._command.version
        self._cadence.reset()
        try:
            self._device.arm(now_ns)
        except RuntimeError as refusal:
            self._reply(str(refusal))
        else:
            self._reply("")

    def _take_command(self) -> None:
        version = self._command.version
        if not self._cadence.takes(self._simulation.time_ns // STEP_NS, version != self._taken):
            return
        record = self._command.read()
        if record is None:
            return
        self._taken = version
        command = record[0]
        self._device.write(
            RobotCommand(
                int(command["sequence"]),
                Mode(int(command["mode"])),
                command["position"],
                command["torque_limit"],
                command["torque"],
            ),
            self._simulation.time_ns,
        )

    def _publish(self) -> None:
        simulation, out = self._simulation, self._state.record[0]
        state = self._device.read(simulation.time_ns)
        sample = self._sensors.object_pose(simulation.time_ns)
        out["scene_ns"] = simulation.time_ns
        out["now_ns"] = simulation.time_ns + self._offset_ns
        out["sequence"], out["status"] = state.sequence, int(state.status)
        out["fault"] = state.fault.encode("ascii", "replace")
        out["position"], out["velocity"], out["torque"] = state.position, state.velocity, state.torque
        out["stamp_ns"] = int(state.stamp_ns[0]) + self._offset_ns
        out["pose_stamp_ns"] = -1 if sample is None else sample.stamp_ns + self._offset_ns
        out["X_world_box"] = np.eye(4) if sample is None else sample.X_world_box
        out["qpos"] = simulation.data.qpos
        out["mocap_pos"][: simulation.model.nmocap] = simulation.data.mocap_pos
        self._state.publish()
