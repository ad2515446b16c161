"""The robot within one tick: what was measured, what each arm and hand is asked to do, and the setpoint that follows.

An arm is asked either for joint angles or for a palm pose, which whole-body IK turns into joint angles;
fingers are asked for joint angles with the torque they may use. Everything goes through ruckig.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from preshape.control.aim import Aim
from preshape.control.controller import Setpoint
from preshape.control.ik import ArmIk
from preshape.control.link_boxes import LinkBoxes
from preshape.control.smoothing import SmoothConfig, Smoother
from preshape.hal.layout import ARM_DOF, LAYOUT, SIDES, Side
from preshape.hal.state import RobotState, Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import Workcell
from preshape.planner.arm_kinematics import palm_pose

_ARMS = np.concatenate([np.arange(LAYOUT.dof)[LAYOUT.arm(side)] for side in SIDES])
_TRACKED = np.isin(np.arange(LAYOUT.dof), _ARMS)


class Body:
    """Both arms and hands: measurements in, requests kept until changed, one setpoint a tick out.

    `aims` says what a hand is on its way to, for those who watch; nothing here depends on it.
    """

    def __init__(self, cell: Workcell, period_s: float) -> None:
        """Build IK, smoothing and kinematics for a workcell and the loop's period."""
        self.cell, self.period_s = cell, period_s
        self.links = LinkBoxes(cell.X_world_base)
        self._ik = ArmIk(cell.X_world_base)
        self._smoother = Smoother(SmoothConfig(period_s=period_s))
        self._goal = np.zeros(LAYOUT.dof)
        self._last_goal = np.zeros(LAYOUT.dof)
        self._limit = LAYOUT.torque.copy()
        self._palm_goal: dict[Side, Matrix | None] = {side: None for side in SIDES}
        self._posture = np.zeros(len(_ARMS))
        self._started = False
        self.aims: dict[Side, Aim] = {}
        self.stands = False
        """Whether the arms stand still in this tick, whatever they are asked for; the fingers go on."""
        self.now_ns = 0
        self.age_ns: Vector = np.zeros(LAYOUT.dof)
        self.position: Vector = np.zeros(LAYOUT.dof)
        self.velocity: Vector = np.zeros(LAYOUT.dof)
        self.torque: Vector = np.zeros(LAYOUT.dof)

    def follow(self, position: Vector, velocity: Vector) -> None:
        """Continue from this command; the first one also becomes what every joint is asked for."""
        self._smoother.seed(position, velocity)
        if not self._started:
            self._started = True
            self._goal[:] = np.clip(position, LAYOUT.lower, LAYOUT.upper)
            self._last_goal[:] = self._goal
            self._posture = self._goal[_ARMS].copy()
            self._ik.set_nominal(self._posture)

    def update(self, now_ns: int, state: RobotState) -> None:
        """Take this tick's sample."""
        self.now_ns, self.age_ns = now_ns, now_ns - state.stamp_ns
        self.position, self.velocity, self.torque = state.position, state.velocity, state.torque
        self.links.update(state.position)

    @property
    def commanded(self) -> tuple[Vector, Vector]:
        """Position (40,), rad, and velocity (40,), rad/s, of the last command."""
        return self._smoother.position, self._smoother.velocity

    def palm(self, side: Side) -> Matrix:
        """Return the measured X_world_palm."""
        return self.links.palm(side)

    def asked_palm(self, side: Side) -> Matrix:
        """Return X_world_palm of what the arm was last asked for."""
        asked = self._palm_goal[side]
        return palm_pose(side, self.cell.X_world_base[side], self._goal[LAYOUT.arm(side)]) if asked is None else asked

    def asked_arm(self, side: Side) -> Vector:
        """Return the joint angles (7) that the arm was last asked for."""
        return self._goal[LAYOUT.arm(side)].copy()

    def asked_arms(self) -> Vector:
        """Return the joint angles (14) that both arms were last asked for, right then left."""
        return self._goal[_ARMS].copy()

    def asked_fingers(self, side: Side) -> Vector:
        """Return the joint angles (13) that a hand was last asked for."""
        return self._goal[LAYOUT.hand(side)].copy()

    def ask_arm(self, side: Side, q: ArrayLike) -> None:
        """Ask one arm for joint angles (7), rad."""
        self._palm_goal[side] = None
        self._goal[LAYOUT.arm(side)] = q

    def ask_palm(self, side: Side, X_world_palm: Matrix) -> None:
        """Ask one arm to bring its palm to a pose."""
        self._palm_goal[side] = X_world_palm

    def prefer_posture(self, side: Side, q: ArrayLike, hurry: float = 1.0) -> None:
        """Choose the arm posture (7), rad, that the redundancy drifts to while the palm is led, and how fast."""
        start = SIDES.index(side) * ARM_DOF
        self._posture[start : start + ARM_DOF] = q
        self._ik.set_nominal(self._posture, hurry)

    def ask_fingers(self, side: Side, q: ArrayLike, torque_limit: ArrayLike | None = None) -> None:
        """Ask one hand for joint angles (13), rad, within torque limits (13), N m (default: the joints' own)."""
        hand = LAYOUT.hand(side)
        self._goal[hand] = q
        self._limit[hand] = LAYOUT.torque[hand] if torque_limit is None else torque_limit

    def setpoint(self) -> Setpoint:
        """Return this tick's command: IK where a palm is led, then ruckig from the last command."""
        if self.stands:
            self._goal[_ARMS] = self._last_goal[_ARMS]
        elif any(goal is not None for goal in self._palm_goal.values()):
            self._solve_palms()
        goal = np.minimum(np.maximum(self._goal, LAYOUT.lower), LAYOUT.upper)
        # Fingers led by torque have noisy goals: only the arms' goals carry a speed worth meeting.
        speed = np.zeros(LAYOUT.dof)
        speed[_ARMS] = (goal - self._last_goal)[_ARMS] / self.period_s
        step = self._smoother.update(goal, speed, _TRACKED)
        self._last_goal[:] = goal
        return Setpoint(step.position, self._limit)

    def _solve_palms(self) -> None:
        right, left = (self.asked_palm(side) for side in SIDES)
        step = self._ik.solve(self._goal[_ARMS], right, left, self.period_s)
        for number, side in enumerate(SIDES):
            if self._palm_goal[side] is not None:
                self._goal[LAYOUT.arm(side)] = step.q[number * ARM_DOF : (number + 1) * ARM_DOF]
