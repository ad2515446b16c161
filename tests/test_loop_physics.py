"""The loop with IK, smoothing and gate on the simulated robot, in lockstep."""

from __future__ import annotations

import time

import numpy as np
import pytest

from preshape.control.controller import Setpoint
from preshape.control.ik import ArmIk
from preshape.control.loop import ControlLoop
from preshape.control.loop_result import LoopOutcome, LoopResult
from preshape.control.observer import Observers
from preshape.control.smoothing import Smoother
from preshape.hal.gate import SafetyGate
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import RobotState
from preshape.hal.tick_record import TickRecord, note_progress
from preshape.hal.transform import exp_so3, transform
from preshape.planner.arm_kinematics import palm_pose
from preshape.sim_backend.device import MujocoDevice
from preshape.sim_backend.lockstep import SimClock
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import arm_bases
from preshape.sim_backend.simulation import Simulation

pytestmark = pytest.mark.physics

DT = 0.002
ARMS = np.concatenate([np.arange(LAYOUT.dof)[LAYOUT.arm(side)] for side in SIDES])


class PalmMover:
    """Moves both palms to targets a little away, fingers bending, then finishes."""

    def __init__(self, scenario: Scenario, ticks: int) -> None:
        self.bases = arm_bases(scenario)
        self.ik, self.smoother, self.ticks = ArmIk(self.bases), Smoother(), ticks
        self.q = np.empty(14)
        self.targets: list[np.ndarray] = []
        self.goal = np.empty(LAYOUT.dof)
        self.told = 0

    def follow(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.told += 1
        self.smoother.seed(position, velocity)
        self.q, self.goal = position[ARMS].copy(), position.copy()
        if not self.targets:
            self.ik.set_nominal(self.q)
            for k, side in enumerate(SIDES):
                X = palm_pose(side, self.bases[side], self.q[7 * k : 7 * k + 7])
                self.targets.append(transform(X[:3, 3] + [0.05, 0.03, 0.08], exp_so3([0.0, 0.3, 0.2]) @ X[:3, :3]))

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        self.q = self.ik.solve(self.q, self.targets[0], self.targets[1], DT).q
        self.goal[ARMS] = self.q
        for side in SIDES:
            self.goal[LAYOUT.finger(side, "fore")] = (0.0, 0.5, 0.4)
        return Setpoint(self.smoother.update(self.goal).position, LAYOUT.torque, tick + 1 >= self.ticks)

    def note(self, record: TickRecord) -> None:
        note_progress(record, 1, "reach", "", None)


def _run(ticks: int = 1200) -> tuple[LoopResult, PalmMover, SafetyGate, RobotState]:
    scenario = Scenario(name="reach").drawn(0)
    simulation = Simulation(scenario)
    device, clock, gate = MujocoDevice(simulation), SimClock(simulation), SafetyGate()
    device.open()
    controller = PalmMover(scenario, ticks)
    loop = ControlLoop(device, clock, gate, Observers(), time.perf_counter_ns)
    result = loop.run(controller)
    state = device.read(clock.now_ns())
    device.close()
    return result, controller, gate, state


def test_the_palms_arrive_and_nothing_met_a_limit_of_the_gate() -> None:
    result, controller, gate, state = _run()
    assert result.outcome is LoopOutcome.FINISHED and result.refused == 0
    assert controller.told == 1
    assert not any(gate.counts[name] for name in ("position", "velocity", "acceleration", "torque", "stale"))
    for side, target in zip(SIDES, controller.targets, strict=True):
        X = palm_pose(side, controller.bases[side], state.position[LAYOUT.arm(side)])
        assert np.linalg.norm(X[:3, 3] - target[:3, 3]) < 0.005


def test_the_same_run_twice_writes_the_same_bytes() -> None:
    assert _run(300)[0].commands_sha256 == _run(300)[0].commands_sha256
