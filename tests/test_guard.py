"""Laws of the guard and of paths: no motion touches an obstacle, a way back stays open, another path is found."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from preshape.control import work as work_module
from preshape.control.body import Body
from preshape.control.carrier import CarryOptions
from preshape.control.distances import Boxes, PairDistances, pair_distances
from preshape.control.failure import TaskFailed
from preshape.control.guard import MARGIN_M, PATIENCE_S, ObstacleGuard, stopping_position
from preshape.control.hand import Hand
from preshape.control.link_boxes import NODE_COUNT, PARTS, LinkBoxes, arm_nodes, hand_nodes
from preshape.control.motions import Motion, lead_palm
from preshape.control.sight import Sight
from preshape.control.smoothing import Smoother
from preshape.control.work import DETOURS, ROOM_M, Work
from preshape.hal import sah_hand
from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.state import DeviceStatus, RobotState, Vector
from preshape.hal.transform import Matrix, transform
from preshape.hal.world import NominalBox, OrientedBox
from preshape.planner.arm_collision import ArmCollision
from preshape.planner.arm_path import ArmPath, PathQuery, PathStatus
from preshape.planner.work_object import box_object
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell
from preshape.sim_backend.simulation import home_position

PERIOD_S = 0.002
CELL = workcell(Scenario(name="cell"))
BOX = NominalBox(np.array([0.06, 0.09, 0.20]), ("+x", "-x"))


class World:
    """A robot that follows its commands exactly, and obstacles that are there from one tick to the next."""

    def __init__(self) -> None:
        self.body = Body(CELL, PERIOD_S)
        self.sight = SimpleNamespace(obstacles=(), held_by=None, estimate=None, X_world_box=np.eye(4))
        self.guard = ObstacleGuard(self.body, cast(Sight, self.sight), BOX)
        self.links = LinkBoxes(CELL.X_world_base)
        self.nearest = np.inf
        self.now_ns = 0
        self.position: Vector = home_position()
        self.body.follow(self.position, np.zeros(LAYOUT.dof))
        self._take()

    def _take(self) -> None:
        zeros, stamps = np.zeros(LAYOUT.dof), np.full(LAYOUT.dof, self.now_ns)
        state = RobotState(0, self.position, zeros, zeros, stamps, DeviceStatus.ARMED, "")
        self.body.update(self.now_ns, state)

    def place(self, p: Matrix, size: float) -> None:
        self.sight.obstacles = (OrientedBox("obstacle_post", transform(p), np.full(3, size / 2)),)

    def tick(self, motion: Motion) -> None:
        """One tick as the controller makes it; `nearest` keeps the least true distance to an obstacle."""
        self.now_ns += round(PERIOD_S * 1e9)
        self._take()
        self.guard.look()
        self.body.stands = self.guard.blocked
        if not self.guard.blocked:
            next(motion)
        elif self.guard.stood_s > PATIENCE_S:
            motion.throw(TaskFailed(f"stalled: {self.guard.give_up()}"))
        self.position = self.body.setpoint().position.copy()
        if self.sight.obstacles:
            poses, obstacles = self.links.update(self.position), Boxes.of(self.sight.obstacles)
            out = PairDistances.empty(NODE_COUNT)
            pairs = np.array([(node, 0) for node in range(NODE_COUNT)])
            pair_distances("l2", Boxes(poses.p_box, poses.R_box, self.links.half), obstacles, pairs, out)
            self.nearest = min(self.nearest, float(out.distance.min()))

    def run(self, motion: Motion, seconds: float = 30.0) -> None:
        for _ in range(round(seconds / PERIOD_S)):
            try:
                self.tick(motion)
            except StopIteration:
                return
        raise AssertionError(f"the motion has not ended within {seconds} s")


def beside(X: Matrix, dy: float, size: float) -> Matrix:
    """Return the centre of a cube beside a hand, at its height."""
    return X[:3, 3] + np.array([0.0, dy + np.sign(dy) * size / 2, -0.1])


def test_joints_come_to_rest_where_it_is_said_or_before() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        smoother = Smoother()
        start = 0.5 * (LAYOUT.lower + LAYOUT.upper)
        velocity = rng.uniform(-0.5, 0.5, LAYOUT.dof) * LAYOUT.velocity
        smoother.seed(start, velocity)
        way = np.abs(stopping_position(start, velocity) - start)
        while np.abs(smoother.velocity).max() > 1e-6:
            smoother.brake()
        moved = np.abs(smoother.position - start)
        assert (moved[LAYOUT.arm("right")] <= way[LAYOUT.arm("right")] + 1e-3).all()


@pytest.mark.parametrize("speed", [0.05, 0.2, 0.4])
def test_a_palm_led_straight_at_an_obstacle_stops_short_of_it_and_the_motion_is_given_up_by_name(speed: float) -> None:
    world = World()
    X = world.body.palm("right")
    world.place(beside(X, 0.20, 0.06), 0.06)
    with pytest.raises(TaskFailed, match=r"stalled: the right \w+ \d+ mm from obstacle_post"):
        world.run(lead_palm(world.body, "right", transform((0.0, 0.3, 0.0)) @ X, speed))
    assert 0.5 * MARGIN_M < world.nearest < 3.0 * MARGIN_M
    assert np.abs(world.body.commanded[1]).max() < 1e-3, "and stands"


def test_an_obstacle_that_appears_in_front_of_a_moving_palm_is_not_touched_and_the_way_back_is_open() -> None:
    world = World()
    X = world.body.palm("right")
    motion = lead_palm(world.body, "right", transform((0.0, 0.3, 0.0)) @ X, 0.15)
    for _ in range(400):
        world.tick(motion)
    world.place(beside(world.body.palm("right"), 0.12, 0.06), 0.06)
    with pytest.raises(TaskFailed, match="stalled"):
        world.run(motion)
    assert world.nearest > 0.0
    world.run(lead_palm(world.body, "right", X, 0.1))
    np.testing.assert_allclose(world.body.palm("right"), X, atol=2e-3)


def test_what_leads_past_an_obstacle_is_not_held_up() -> None:
    world = World()
    X = world.body.palm("right")
    world.place(X[:3, 3] + np.array([0.0, 0.0, -0.45]), 0.06)
    before = world.now_ns
    world.run(lead_palm(world.body, "right", transform((0.0, 0.2, 0.0)) @ X, 0.1))
    assert (world.now_ns - before) * 1e-9 < 4.0


def test_an_obstacle_that_goes_away_lets_the_motion_go_on() -> None:
    world = World()
    X = world.body.palm("right")
    world.place(beside(X, 0.15, 0.06), 0.06)
    motion = lead_palm(world.body, "right", transform((0.0, 0.3, 0.0)) @ X, 0.2)
    while not world.guard.blocked:
        world.tick(motion)
    for _ in range(200):
        world.tick(motion)
    world.sight.obstacles = ()
    world.run(motion)
    np.testing.assert_allclose(world.body.palm("right")[:3, 3], X[:3, 3] + [0.0, 0.3, 0.0], atol=5e-3)


def ground(world: World) -> Work:
    hands: dict[Side, Hand] = {side: Hand(side, world.body) for side in SIDES}
    return Work(CELL, BOX, box_object(BOX), world.body, cast(Sight, world.sight), hands, world.guard, CarryOptions())


def test_an_obstacle_that_appears_on_an_arms_path_is_gone_around() -> None:
    world = World()
    work = ground(world)
    X = world.body.palm("left")
    q = work.posture("left", transform((0.05, -0.45, 0.0)) @ X)
    assert q is not None
    motion = work.travel("left", q)
    for _ in range(150):
        world.tick(motion)
    world.place(X[:3, 3] + np.array([0.03, -0.23, -0.12]), 0.03)
    world.run(motion)
    np.testing.assert_allclose(world.body.position[LAYOUT.arm("left")], q, atol=5e-3)
    assert any("another path" in note for note in work.notes)
    assert world.nearest > 0.5 * MARGIN_M


def test_where_no_path_is_left_the_arm_stalls_by_name() -> None:
    world = World()
    work = ground(world)
    X = world.body.palm("left")
    q = work.posture("left", transform((0.1, -0.35, 0.0)) @ X)
    assert q is not None
    motion = work.travel("left", q)
    for _ in range(50):
        world.tick(motion)
    world.place(X[:3, 3] + np.array([0.1, -0.35, -0.05]), 0.12)
    with pytest.raises(TaskFailed, match=r"stalled: no path for the left arm .*obstacle_post"):
        world.run(motion)
    assert world.nearest > 0.5 * MARGIN_M


@pytest.mark.parametrize("body", ["right_arm", "right_hand"])
def test_the_distance_of_arms_and_fingers_is_that_of_the_planners_capsules(body: str) -> None:
    rng = np.random.default_rng(5)
    world = World()
    checked = 0
    for _ in range(40):
        arms = 0.5 * (LAYOUT.lower + LAYOUT.upper)
        arms[LAYOUT.arm("right")] += rng.uniform(-0.6, 0.6, 7)
        poses = world.links.update(arms)
        # Near the forearm, which is long: its bounding box is much wider than its capsule; or near a finger.
        near = rng.integers(4, 6) if body == "right_arm" else rng.choice(np.arange(NODE_COUNT)[hand_nodes("right")])
        world.place(poses.p_box[near] + rng.normal(0.0, 0.12, 3), 0.05 if body == "right_arm" else 0.02)
        obstacle = world.sight.obstacles[0]
        q_hands: dict[Side, Vector] = {side: arms[LAYOUT.hand(side)] for side in SIDES}
        others = {"right_arm", "right_hand", "left_arm", "left_hand"} - {body}
        exempt = tuple((other, obstacle.name) for other in others)
        model = ArmCollision(CELL, q_hands, None, (obstacle,), exempt)
        found = model.clearance(np.concatenate([arms[LAYOUT.arm(side)] for side in SIDES]))
        distance = world.guard.distances(arms, Boxes.of([obstacle]))
        own = distance[arm_nodes("right") if body == "right_arm" else hand_nodes("right")]
        round_ones = [
            PARTS[number] for number in range(len(PARTS)) if sah_hand.PARTS[PARTS[number]][0].kind == "capsule"
        ]
        # Palm and knuckles are boxes here, which stick out of their capsules.
        if found.bodies != (body, obstacle.name) or (
            body == "right_hand" and PARTS[int(own.argmin())] not in round_ones
        ):
            continue
        checked += 1
        assert float(own.min()) == pytest.approx(found.distance, abs=1e-9)
    assert checked >= 10


def test_what_stands_nearer_to_an_obstacle_than_a_path_may_lead_still_gets_away() -> None:
    world = World()
    work = ground(world)
    X = world.body.palm("right")
    gap = 0.13
    while work.collision().is_free(work.body.asked_arms(), 0.0, ROOM_M):
        gap -= 0.002
        world.place(beside(X, gap, 0.06), 0.06)
    assert work.collision().is_free(work.body.asked_arms()), "it stands too near for a path, and is free"
    q = work.posture("right", transform((0.0, -0.2, 0.05)) @ X)
    assert q is not None
    world.run(work.travel("right", q))
    np.testing.assert_allclose(world.body.position[LAYOUT.arm("right")], q, atol=5e-3)
    assert world.nearest > 0.0


def test_an_obstacle_beside_the_arm_at_rest_is_not_in_the_way_of_the_other() -> None:
    world = World()
    work = ground(world)
    world.place(beside(world.body.palm("right"), -0.100, 0.06), 0.06)
    X = transform((0.05, 0.0, 0.05)) @ world.body.palm("left")
    assert work.posture("left", X, work.collision()) is None
    assert work.posture("left", X, work.collision(work.at_rest("left"))) is not None


def test_around_obstacles_the_shortest_of_several_paths_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World()
    work = ground(world)
    asked: list[int] = []

    def planned(model: ArmCollision, start: Vector, goal: Vector, query: PathQuery) -> ArmPath:
        asked.append(query.seed)
        detour = start + 0.1 * abs(query.seed - 2) * np.ones(len(start))
        return ArmPath(PathStatus.FOUND, np.array([start, detour, goal]))

    monkeypatch.setattr(work_module, "plan_path", planned)
    q = work.body.asked_arm("right") + 0.05
    next(work.travel("right", q))
    assert asked == [0]
    world.place(world.body.palm("right")[:3, 3] + np.array([0.0, 0.0, -0.5]), 0.03)
    asked.clear()
    waypoints = work._path("right", q, (), 0)  # pyright: ignore[reportPrivateUsage]
    assert asked == list(range(DETOURS))
    np.testing.assert_allclose(waypoints[1], waypoints[0], err_msg="the third goes straight")


@pytest.mark.parametrize("first_hangs", [False, True])
def test_with_a_box_in_the_hand_the_quickest_path_is_taken_on_which_it_does_not_hang_on_the_thumb(
    monkeypatch: pytest.MonkeyPatch, first_hangs: bool
) -> None:
    world = World()
    work = ground(world)
    world.sight.X_world_box = world.body.palm("right") @ transform((0.0, 0.0, 0.2))
    world.sight.held_by = "right"
    start, sideways = work.body.asked_arm("right"), np.eye(7)[5]

    def planned(model: ArmCollision, start: Vector, goal: Vector, query: PathQuery) -> ArmPath:
        detour = start.copy()
        detour[:7] += (0.2 + 0.02 * query.seed) * sideways
        return ArmPath(PathStatus.FOUND, np.vstack([start, detour, goal]))

    hung = iter([float(first_hangs)] + [0.0] * (DETOURS - 1))
    monkeypatch.setattr(work_module, "plan_path", planned)
    monkeypatch.setattr(work_module, "hanging", lambda R: next(hung))  # pyright: ignore[reportUnknownLambdaType]
    waypoints = work._path("right", start + 0.05, (), 0)  # pyright: ignore[reportPrivateUsage]
    taken = round(float((waypoints[1] - waypoints[0])[5] - 0.2) / 0.02)
    assert taken == int(first_hangs)
