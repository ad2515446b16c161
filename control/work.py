"""What every task works with: the robot, the box, paths for the arms, and a place to say what is going on."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from preshape.control.body import Body
from preshape.control.carrier import CarryOptions
from preshape.control.failure import TaskFailed
from preshape.control.grip import Grip
from preshape.control.guard import ObstacleGuard
from preshape.control.hand import Hand
from preshape.control.hanging import hanging
from preshape.control.motions import Motion, follow_arms, gentle_seconds, wait
from preshape.control.sight import Sight
from preshape.hal.layout import ARM_DOF, LAYOUT, SIDES, Side
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, inverse, log_so3, transform
from preshape.hal.world import Face, NominalBox, Opening, OrientedBox, TextureLibrary, Workcell
from preshape.planner.arm_capsules import HeldBox
from preshape.planner.arm_chain import posture_chain
from preshape.planner.arm_collision import ArmCollision
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.arm_path import ALLOWED_DIP, ArmPath, PathQuery, PathStatus, plan_path, way_out
from preshape.planner.arm_reach import ReachQuery, ReachStatus, reach
from preshape.planner.plan import Plan
from preshape.planner.work_object import WorkObject

CARRY_MARGIN_M = 0.035
"""Clearance that paths keep while a box is held: its edges stick out of the held box's coarse shape, m."""
PATH_MARGIN_M = 0.020
"""Clearance that paths keep otherwise, m."""
PATHS = 4
"""How many paths are tried while obstacles appear on them."""
DETOURS = 8
"""How many paths the best is chosen from where the straight one is not free."""
HANGING_S = 10.0
"""Time that it is worth not to bring the box to hang on the thumb of the hand that carries it, s.

With friction 0.4 a box slid out of the hand where it hung so.
"""
ROOM_M, CLOSE_ROOM_M = 0.015, 0.008
"""What is kept beyond that from obstacles that have appeared, and where they leave no more, m (the guard: 10 mm)."""
AROUND_SPEED = 0.15
"""Share of the joint speed limits with which an arm goes around obstacles, and draws away from them."""
BRAKE_S = 0.4
"""Time in which an arm that is asked to stop is at rest, s."""
MOVED_M = 0.005
"""An obstacle that is seen this far from where it was has moved, m."""
CARRY_ACCELERATION = 0.3
"""Largest acceleration of a held box's centre and ends while it is carried, m/s^2: more makes it slide in the grip."""
CARRY_TURN_SPEED = 0.45
"""Largest turning speed of a held box, rad/s."""
CLEARANCE_M, CLOSE_M = 0.020, 0.008
"""Clearance that chosen arm postures keep from everything they must not touch, and where obstacles leave no more, m."""


@dataclass(slots=True, eq=False)
class Work:
    """The shared ground of one procedure; `task` and `phase` are what observers are told.

    `box` is the object's outer size and what may open, `target` its parts as the planner knows them. `library` is
    the known look of an opening, None for an object that has none; `blank` are faces that were seen to have none.
    `stood_at` is the box's pose where it was taken from and `taken_at` the palm's there, `seen_at` the box's pose when
    the opening was found (all world); `plan` is the one that grips were chosen from.
    """

    cell: Workcell
    box: NominalBox
    target: WorkObject
    body: Body
    sight: Sight
    hands: dict[Side, Hand]
    guard: ObstacleGuard
    carry: CarryOptions
    library: TextureLibrary | None = None
    opening: Opening | None = None
    blank: set[Face] = field(default_factory=set)
    grips: dict[Side, Grip] = field(default_factory=dict)
    seen_at: Matrix | None = None
    stood_at: Matrix | None = None
    taken_at: Matrix | None = None
    plan: Plan | None = None
    task: int = 1
    phase: str = "start"
    notes: list[str] = field(default_factory=list)
    _wants_room: bool = False

    def collision(
        self,
        exempt: tuple[tuple[str, str], ...] = (),
        held: HeldBox | None = None,
        standing: Matrix | None = None,
        fingers: Mapping[Side, Vector] | None = None,
    ) -> ArmCollision:
        """Return the coarse model of this moment: hands as they are, the box held or standing.

        `held` says how it is held, `standing` at which pose (world) it stands; by default it is where it is seen.
        `fingers` are the joint angles (13) of hands that will change.
        """
        if held is None and standing is None:
            held = self._held()
        parts: tuple[OrientedBox, ...] = ()
        if standing is None and held is None and self.sight.estimate is not None:
            standing = self.sight.X_world_box
        if standing is not None:
            boxes = self.target.boxes(standing)
            parts = tuple(OrientedBox("box", part.X_world_box, part.half) for part in boxes)
        q_hands: dict[Side, Vector] = {side: self.body.asked_fingers(side) for side in SIDES}
        q_hands.update(fingers or {})
        return ArmCollision(self.cell, q_hands, held, parts, exempt, tuple(self.sight.obstacles))

    def at_rest(self, side: Side) -> tuple[tuple[str, str], ...]:
        """Return the pairs of what this arm does not move: the other arm and its hand, wherever obstacles are."""
        other = next(one for one in SIDES if one != side)
        bodies = f"{other}_arm", f"{other}_hand"
        return tuple((body, seen.name) for seen in self.sight.obstacles for body in bodies)

    def known_look(self) -> TextureLibrary:
        """Return the known look of the opening; `TaskFailed` for an object that has none."""
        if self.library is None:
            raise TaskFailed("unseen: nothing is known of how an opening looks")
        return self.library

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
        base, q_arms = self.cell.X_world_base[side], self.body.asked_arms()
        for margin, more in self._margins():
            query = ReachQuery(margin_m=margin, more_m=more)
            found = reach(side, base, X_world_palm, model, q_arms, query, near=near)
            if found.status is ReachStatus.REACHABLE:
                return found.q
        return None

    def way(self, side: Side, X_world_palms: Matrix, models: Sequence[ArmCollision], near: Vector) -> Matrix | None:
        """Return arm joints (n, 7) for palm poses (n, 4, 4) that follow each other, or None where an arm cannot.

        Each posture is near the one before and keeps clear of what the model of its own pose holds.
        """
        q_arms = self.body.asked_arms()
        for margin, more in self._margins():

            def is_free(number: int, q: Vector, margin: float = margin, more: float = more) -> bool:
                q_arms[_own(side)] = q
                return models[number].is_free(q_arms, margin, more)

            chain = posture_chain(side, self.cell.X_world_base[side], X_world_palms, near, is_free)
            if chain is not None:
                return chain
        return None

    def _margins(self) -> tuple[tuple[float, float], ...]:
        """Return the clearances to be tried, each with what is kept beyond it from obstacles."""
        if not self.sight.obstacles:
            return ((CLEARANCE_M, 0.0),)
        roomy = (CLEARANCE_M, ROOM_M), (CLOSE_M, ROOM_M)
        return roomy if self._wants_room else (*roomy, (CLOSE_M, CLOSE_ROOM_M))

    @contextmanager
    def wanting_room(self) -> Generator[None]:
        """Count no posture for the time being that is near to obstacles: what is planned will not be met exactly."""
        self._wants_room = True
        try:
            yield
        finally:
            self._wants_room = False

    def travel(self, side: Side, q: Vector, speed: float = 0.35, exempt: tuple[tuple[str, str], ...] = ()) -> Motion:
        """Bring one arm to joint angles (7) on a path free of coarse collisions; `TaskFailed` if there is none.

        An obstacle that appears on the way stops the arm, and it goes on by another path.
        """
        for number in range(PATHS):
            waypoints = self._path(side, q, exempt, number)
            self.body.prefer_posture(side, q)
            why = "an obstacle on it"
            # An arm that brakes leaves its path, the farther the faster it was: each joint comes to rest by itself.
            share = min(speed, AROUND_SPEED) if self.sight.obstacles else speed
            try:
                arrived = yield from self._follow(side, waypoints, share, exempt)
            except TaskFailed as failed:
                # What the guard has stopped is not stopped again on every path.
                if failed.kind != "stalled" or number == PATHS - 1:
                    raise
                arrived, why = False, failed.cause
            if arrived:
                return
            self.notes.append(f"task {self.task} ({self.phase}): the {side} arm takes another path: {why}")
            yield from wait(self.body, BRAKE_S)
        raise TaskFailed(f"stalled: the {side} arm has met obstacles on {PATHS} paths")

    def _path(self, side: Side, q: Vector, exempt: tuple[tuple[str, str], ...], number: int) -> Matrix:
        """Return way-points (n, 14) from where both arms are asked to be to a posture (7) of one; others by number."""
        goal = self.body.asked_arms()
        start = goal.copy()
        goal[_own(side)] = q
        exempt = (*exempt, *self.at_rest(side))
        model = self.collision(exempt)
        # Nearer to an obstacle than the guard lets it go on it has to get away from there first.
        out = self._way_out(side, model, model, start, number)
        path = self._best_path(side, model, start if out is None else out, goal, number)
        if path.status is not PathStatus.FOUND:
            bodies = " ".join((path.status.name.lower(), *path.bodies)).rstrip()
            raise self.no_way(f"no path for the {side} arm ({bodies})")
        return path.waypoints if out is None else np.vstack([start, path.waypoints])

    def make_room(self, side: Side, fingers: Mapping[Side, Vector]) -> Motion:
        """Draw an arm away from obstacles that its hand with other joint angles (13) is too near to, if it can."""
        start, exempt = self.body.asked_arms(), self.at_rest(side)
        out = self._way_out(side, self.collision(exempt), self.collision(exempt, fingers=fingers), start)
        if out is not None:
            yield from follow_arms(self.body, np.array([start, out]), AROUND_SPEED)

    def _way_out(
        self, side: Side, model: ArmCollision, there: ArmCollision, start: Vector, number: int = 0
    ) -> Vector | None:
        """Return a posture (14) near `start` with room around it, by what holds there; None if it has, or has none."""
        query = PathQuery(margin_m=CLOSE_M, more_m=ROOM_M, step_rad=0.02, seed=number)
        if not self.sight.obstacles or there.is_free(start, query.margin_m, query.more_m):
            return None
        return way_out(model, start, np.arange(len(start))[_own(side)], query, there)

    def _best_path(self, side: Side, model: ArmCollision, start: Vector, goal: Vector, number: int) -> ArmPath:
        """Return a path: among obstacles, or with the box in the hand, the one of several detours that costs least."""
        margin = PATH_MARGIN_M if self.sight.held_by is None else CARRY_MARGIN_M
        count = DETOURS if self.sight.held_by == side or self.sight.obstacles else 1
        queries = [PathQuery(margin_m=margin, more_m=ROOM_M, seed=count * number + k) for k in range(count)]
        first = plan_path(model, start, goal, queries[0])
        if not first.by_chance:
            return first
        others = (plan_path(model, start, goal, query) for query in queries[1:])
        return min((first, *others), key=lambda path: self._cost(side, path))

    def _cost(self, side: Side, path: ArmPath) -> float:
        """Return what a path costs: an empty hand its length, rad; one with the box its time, s, more if it hangs."""
        if path.status is not PathStatus.FOUND:
            return np.inf
        held = self._held()
        if held is None or held.side != side:
            return path.length
        legs = list(self._palms(side, path.waypoints))
        return sum(self._gentle(held, legs)) + HANGING_S * hanging(np.concatenate(legs)[:, :3, :3])

    def _palms(self, side: Side, waypoints: Matrix) -> Iterator[Matrix]:
        """Yield the palm's poses (n, 4, 4), world, along each leg between way-points (m, 14)."""
        base = self.cell.X_world_base[side]
        for a, b in pairwise(waypoints[:, _own(side)]):
            yield np.array([palm_pose(side, base, a + u * (b - a)) for u in np.linspace(0.0, 1.0, 41)])

    def _follow(
        self, side: Side, waypoints: Matrix, speed: float, exempt: tuple[tuple[str, str], ...]
    ) -> Generator[None, None, bool]:
        """Follow way-points (n, 14); return False, the arms asked to stop, when what has appeared lies on the rest."""
        held = self._held()
        gentle = self._gentle(held, self._palms(side, waypoints)) if held is not None and held.side == side else None
        seen = self.sight.obstacles
        for leg in range(len(waypoints) - 1):
            least_s = None if gentle is None else gentle[leg : leg + 1]
            for _ in follow_arms(self.body, waypoints[leg : leg + 2], speed, least_s):
                yield
                if has_changed(seen, self.sight.obstacles):
                    seen = self.sight.obstacles
                    rest = np.vstack([self.body.asked_arms(), waypoints[leg + 1 :]])
                    if not self._keeps_clear(rest, (*exempt, *self.at_rest(side))):
                        return False
        return True

    def _keeps_clear(self, waypoints: Matrix, exempt: tuple[tuple[str, str], ...]) -> bool:
        """Tell whether each two bodies keep half a path's margin, or what the start has, on way-points (n, 14)."""
        model = self.collision(exempt)
        margins = model.margins(PATH_MARGIN_M / 2, waypoints[:1], ALLOWED_DIP, ROOM_M)
        return all(model.edge_free(a, b, margins) for a, b in pairwise(waypoints))

    def _gentle(self, held: HeldBox, legs: Iterable[Matrix]) -> list[float]:
        """Return the least time, s, of each leg, given as palm poses (n, 4, 4), that spares the grip of a held box."""
        half = np.abs(self.box.size / 2 * np.eye(3)[self.box.long_axis])
        ends = [held.X_palm_box @ transform(p) for p in (-half, np.zeros(3), half)]
        times: list[float] = []
        for palms in legs:
            points = np.array([[(X @ end)[:3, 3] for end in ends] for X in palms])
            turn = float(sum(np.linalg.norm(log_so3(A[:3, :3].T @ B[:3, :3])) for A, B in pairwise(palms)))
            times.append(max(gentle_seconds(points, CARRY_ACCELERATION), 15.0 / 8.0 * turn / CARRY_TURN_SPEED))
        return times

    def carry_to_palm(self, side: Side, X_world_palm: Matrix, speed: float = 0.35) -> Motion:
        """Bring the palm of the hand that holds the box to a pose where it will have room to open among obstacles."""
        fingers = self.grips[side].opened if self.sight.obstacles else None
        q = self.posture(side, X_world_palm, self.collision(fingers=fingers))
        if q is None:
            raise self.no_way(f"the {side} palm at {np.round(X_world_palm[:3, 3], 3).tolist()} m")
        yield from self.travel(side, q, speed)

    def no_way(self, what: str) -> TaskFailed:
        """Return the failure of what is out of reach: stalled where obstacles are seen, which may be why."""
        names = " ".join(obstacle.name for obstacle in self.sight.obstacles)
        return TaskFailed(f"stalled: {what}, with {names} in the way" if names else f"unreachable: {what}")

    def limits(self, side: Side) -> tuple[Vector, Vector]:
        """Return the joint limits (13) of a hand, rad."""
        hand = LAYOUT.hand(side)
        return LAYOUT.lower[hand], LAYOUT.upper[hand]


def _own(side: Side) -> slice:
    """Return the slice of one arm's joints in (14,)."""
    return slice(SIDES.index(side) * ARM_DOF, (SIDES.index(side) + 1) * ARM_DOF)


def has_changed(before: Sequence[OrientedBox], now: Sequence[OrientedBox]) -> bool:
    """Tell whether obstacles have come, gone or moved."""
    if len(before) != len(now):
        return True
    return any(
        a.name != b.name or float(np.abs(a.X_world_box[:3, 3] - b.X_world_box[:3, 3]).max()) > MOVED_M
        for a, b in zip(before, now, strict=True)
    )
