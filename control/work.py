"""What every task works with: the robot, the box, paths for the arms, and a place to say what is going on."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from preshape.control.body import Body
from preshape.control.carrier import CarryOptions
from preshape.control.failure import TaskFailed
from preshape.control.grips import Grip
from preshape.control.hand import Hand
from preshape.control.motions import Motion, follow_arms, gentle_seconds
from preshape.control.sight import Sight
from preshape.hal.layout import ARM_DOF, LAYOUT, SIDES, Side
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, inverse, log_so3, transform
from preshape.hal.world import NominalBox, Opening, OrientedBox, TextureLibrary, Workcell
from preshape.planner.arm_capsules import HeldBox
from preshape.planner.arm_collision import ArmCollision
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.arm_path import PathQuery, PathStatus, plan_path
from preshape.planner.arm_reach import ReachQuery, ReachStatus, reach

CARRY_MARGIN_M = 0.035
"""Clearance that paths keep while a box is held: its edges stick out of the held box's coarse shape, m."""
PATH_MARGIN_M = 0.020
"""Clearance that paths keep otherwise, m."""
CARRY_ACCELERATION = 0.3
"""Largest acceleration of a held box's centre and ends while it is carried, m/s^2: more makes it slide in the grip."""
CARRY_TURN_SPEED = 0.45
"""Largest turning speed of a held box, rad/s."""
CLEARANCE_M = 0.020
"""Clearance that chosen arm postures keep from everything they must not touch, m."""


@dataclass(slots=True, eq=False)
class Work:
    """The shared ground of one procedure; `task` and `phase` are what observers are told.

    `stood_at` is the box's pose where it was taken from, `seen_at` its pose when the opening was found (world).
    """

    cell: Workcell
    box: NominalBox
    library: TextureLibrary
    body: Body
    sight: Sight
    hands: dict[Side, Hand]
    carry: CarryOptions
    opening: Opening | None = None
    grips: dict[Side, Grip] = field(default_factory=dict)
    seen_at: Matrix | None = None
    stood_at: Matrix | None = None
    task: int = 1
    phase: str = "start"
    notes: list[str] = field(default_factory=list)

    def collision(self, exempt: tuple[tuple[str, str], ...] = (), held: HeldBox | None = None) -> ArmCollision:
        """Return the coarse model of this moment: hands as they are, the box held (or as `held` says) or standing."""
        held = held or self._held()
        obstacles: list[OrientedBox] = list(self.sight.obstacles)
        if held is None and self.sight.estimate is not None:
            obstacles.append(OrientedBox("box", self.sight.X_world_box, self.box.size / 2))
        q_hands: dict[Side, Vector] = {side: self.body.asked_fingers(side) for side in SIDES}
        return ArmCollision(self.cell, q_hands, held, tuple(obstacles), exempt)

    def _held(self) -> HeldBox | None:
        side = self.sight.held_by
        if side is None:
            return None
        X_palm_box = inverse(self.body.palm(side)) @ self.sight.X_world_box
        return HeldBox(side, X_palm_box, self.box.size / 2)

    def posture(
        self, side: Side, X_world_palm: Matrix, model: ArmCollision | None = None, near: Vector | None = None
    ) -> Vector | None:
        """Return arm joints (7) for a palm pose near a posture (default: as asked now), or None if out of reach."""
        near = self.body.asked_arm(side) if near is None else near
        query = ReachQuery(margin_m=CLEARANCE_M)
        found = reach(side, self.cell.X_world_base[side], X_world_palm, model, self.body.asked_arms(), query, near=near)
        return found.q if found.status is ReachStatus.REACHABLE else None

    def travel(self, side: Side, q: Vector, speed: float = 0.35, exempt: tuple[tuple[str, str], ...] = ()) -> Motion:
        """Bring one arm to joint angles (7) on a path free of coarse collisions; `TaskFailed` if there is none."""
        goal = self.body.asked_arms()
        start = goal.copy()
        own = slice(SIDES.index(side) * ARM_DOF, (SIDES.index(side) + 1) * ARM_DOF)
        goal[own] = q
        margin = PATH_MARGIN_M if self.sight.held_by is None else CARRY_MARGIN_M
        path = plan_path(self.collision(exempt), start, goal, PathQuery(margin_m=margin))
        if path.status is not PathStatus.FOUND:
            bodies = " ".join(path.bodies)
            raise TaskFailed(f"unreachable: no path for the {side} arm ({path.status.name.lower()} {bodies})".rstrip())
        self.body.prefer_posture(side, q)
        yield from follow_arms(self.body, path.waypoints, speed, self._gentle(side, path.waypoints))

    def _gentle(self, side: Side, waypoints: Matrix) -> list[float] | None:
        """Return the least time of each leg that spares the grip of a box in this hand; None when it holds none."""
        held = self._held()
        if held is None or held.side != side:
            return None
        own = slice(SIDES.index(side) * ARM_DOF, (SIDES.index(side) + 1) * ARM_DOF)
        half = np.abs(self.box.size / 2 * np.eye(3)[self.box.long_axis])
        ends = [held.X_palm_box @ transform(p) for p in (-half, np.zeros(3), half)]
        base = self.cell.X_world_base[side]
        times: list[float] = []
        for a, b in zip(waypoints[:-1, own], waypoints[1:, own], strict=True):
            palms = [palm_pose(side, base, a + u * (b - a)) for u in np.linspace(0.0, 1.0, 41)]
            points = np.array([[(X @ end)[:3, 3] for end in ends] for X in palms])
            turn = float(sum(np.linalg.norm(log_so3(A[:3, :3].T @ B[:3, :3])) for A, B in pairwise(palms)))
            times.append(max(gentle_seconds(points, CARRY_ACCELERATION), 15.0 / 8.0 * turn / CARRY_TURN_SPEED))
        return times

    def travel_to_palm(
        self, side: Side, X_world_palm: Matrix, speed: float = 0.35, exempt: tuple[tuple[str, str], ...] = ()
    ) -> Motion:
        """Bring one palm to a pose over a free joint path."""
        q = self.posture(side, X_world_palm, self.collision(exempt))
        if q is None:
            raise TaskFailed(f"unreachable: the {side} palm at {np.round(X_world_palm[:3, 3], 3).tolist()} m")
        yield from self.travel(side, q, speed, exempt)

    def limits(self, side: Side) -> tuple[Vector, Vector]:
        """Return the joint limits (13) of a hand, rad."""
        hand = LAYOUT.hand(side)
        return LAYOUT.lower[hand], LAYOUT.upper[hand]
