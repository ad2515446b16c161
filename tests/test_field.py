"""The field is the negative gradient of its stated potential, grouped as the paper says, and does not chatter."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.distances import NORMS
from preshape.control.field import Field, FieldOptions, HandGoal, carried_twist, hand_error
from preshape.control.goal_clearance import goal_clearance, goal_error, shorten_ranges
from preshape.control.groups import GROUPS, TIES, group_parts
from preshape.control.link_boxes import LinkBoxes, hand_nodes
from preshape.control.obstacles import Kind, Obstacles
from preshape.control.potentials import FieldParameters, attraction, attraction_energy, pose_error, repulsion
from preshape.hal.description import ARM_BASE
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.hal.world import OrientedBox

HOME = np.array([-1.372, -0.859, 1.185, -2.359, 0.814, 1.836, -0.890])
RIGHT = 0


def posture(rng: np.random.Generator) -> Matrix:
    q = np.zeros(LAYOUT.dof)
    q[LAYOUT.arm("right")] = HOME
    q[LAYOUT.arm("left")] = HOME * [-1, 1, -1, 1, -1, 1, -1]
    for side in SIDES:
        hand = LAYOUT.hand(side)
        q[hand] = LAYOUT.lower[hand] + rng.uniform(0.1, 0.7) * (LAYOUT.upper - LAYOUT.lower)[hand]
    return q


def moved_bases(x: Matrix, palm: Matrix) -> dict[str, Matrix]:
    """Arm bases such that the right palm is displaced by (translation, rotation vector about the palm's origin)."""
    about = transform(palm)
    D = transform(x[:3]) @ about @ transform((0, 0, 0), exp_so3(x[3:])) @ transform(-palm)
    return {"right": D @ transform(ARM_BASE["right"]), "left": transform(ARM_BASE["left"])}


def build(q: Matrix, box: Matrix, half: Matrix, options: FieldOptions, x: Matrix | None = None) -> Field:
    links = LinkBoxes()
    links.update(q)
    if x is not None:
        links = LinkBoxes(moved_bases(x, links.palm("right")[:3, 3]))
        links.update(q)
    obstacles = Obstacles(links)
    obstacles.add("box", Kind.OBJECT, [OrientedBox("box", box, half)])
    return Field(links, obstacles, options)


def energy(q: Matrix, box: Matrix, half: Matrix, options: FieldOptions, x: Matrix | None = None) -> float:
    return float(build(q, box, half, options, x).evaluate().energy[RIGHT])


def near_box(q: Matrix, rng: np.random.Generator) -> tuple[Matrix, Matrix]:
    """A box some 10 to 40 mm from one part of the right hand, anyhow turned."""
    links = LinkBoxes()
    poses = links.update(q)
    node = hand_nodes("right").start + int(rng.integers(18))
    away = rng.normal(size=3)
    away /= np.linalg.norm(away)
    half = rng.uniform(0.01, 0.06, 3)
    place = poses.p_box[node] + away * (rng.uniform(0.01, 0.03) + 0.6 * np.linalg.norm(half) + 0.02)
    return transform(place, exp_so3(rng.normal(size=3))), half


@pytest.mark.parametrize("norm", NORMS)
@pytest.mark.parametrize("ties", TIES)
@pytest.mark.parametrize("mode", ["grouped", "summed"])
def test_forces_are_the_negative_gradient_of_the_potential(norm, ties, mode) -> None:
    rng = np.random.default_rng(3)
    options = FieldOptions(norm=norm, ties=ties, mode=mode)
    step, checked = 1e-6, 0
    for _ in range(400):
        if checked == 6:
            return
        q = posture(rng)
        box, half = near_box(q, rng)
        field = build(q, box, half, options)
        results = field.evaluate()
        distances = results.distance[RIGHT, :, 4]
        # The exact norms have corners: at overlap the exit direction may switch, L1 jumps between its 43 directions.
        if not np.any(distances < field.parameters.range_m) or np.any(distances < 0.002):
            continue
        if ties == "hard" and count_ties(field) > 0:
            continue
        wrench, torque = results.wrench[RIGHT].copy(), results.torque[RIGHT].copy()
        base = np.array(
            [energy(q, box, half, options, -step * e) - energy(q, box, half, options, step * e) for e in np.eye(6)]
        ) / (2 * step)
        hand = LAYOUT.hand("right")
        joints = np.zeros(13)
        for k in range(13):
            e = np.zeros(LAYOUT.dof)
            e[hand.start + k] = step
            joints[k] = (energy(q - e, box, half, options) - energy(q + e, box, half, options)) / (2 * step)
        np.testing.assert_allclose(wrench, base, atol=2e-5)
        np.testing.assert_allclose(torque, joints, atol=2e-5)
        checked += 1
    raise AssertionError(f"only {checked} of 400 draws came near the hand without touching it")


def count_ties(field: Field) -> int:
    """Groups whose two nearest boxes are within two epsilon of each other (where the hard mean is no gradient)."""
    from preshape.control.distances import Boxes, PairDistances, pair_distances

    o, poses = field.obstacles, field.links.poses
    nodes = hand_nodes("right")
    links = Boxes(poses.p_box[nodes], poses.R_box[nodes], o.half[nodes])
    first = int(o.first[4])
    out = PairDistances.empty(18)
    obstacle = Boxes(o.p[first : first + 1], o.R[first : first + 1], o.half[first : first + 1])
    pair_distances(field.options.norm, links, obstacle, np.array([[i, 0] for i in range(18)]), out)
    ties = 0
    for group in GROUPS:
        d = np.sort(out.distance[list(group_parts(group))])
        ties += int(len(d) > 1 and d[1] - d[0] < 2 * field.parameters.tie_m and d[0] < field.parameters.range_m)
    return ties


def facing_palm(q: Matrix, gap: float, tilt: Matrix, half: Matrix) -> Matrix:
    """A box in front of the palm's grasp side (+x), turned by `tilt` from parallel."""
    links = LinkBoxes()
    poses = links.update(q)
    palm = hand_nodes("right").start
    X = transform(poses.p_box[palm], poses.R_box[palm])
    return X @ transform((links.half[palm, 0] + gap + half[0], 0.0, 0.0), exp_so3(tilt))


@pytest.mark.parametrize("norm", NORMS)
def test_smooth_field_does_not_chatter_between_parallel_faces(norm) -> None:
    rng = np.random.default_rng(5)
    half = np.array([0.045, 0.03, 0.03])
    q = np.zeros(LAYOUT.dof)
    q[LAYOUT.arm("right")] = HOME

    def largest_turn(ties) -> float:
        torques = []
        for _ in range(30):
            box = facing_palm(q, 0.015, rng.normal(size=3) * 1e-4, half)
            field = build(q, box, half, FieldOptions(norm=norm, ties=ties))
            field.gains.reach[:, 1:] = 0.0
            torques.append(field.evaluate().wrench[RIGHT, 3:].copy())
        return float(np.ptp(np.array(torques), axis=0).max())

    smooth, hard = largest_turn("smooth"), largest_turn("hard")
    assert smooth < 0.002
    assert hard > 10 * smooth


def plate(field_links: LinkBoxes, group: str, direction: Matrix, gap: float) -> tuple[Matrix, Matrix]:
    """A wide plate whose face is `gap` beyond a group's farthest point along a direction (a palm axis)."""
    poses = field_links.poses
    nodes = [hand_nodes("right").start + part for part in group_parts(group)]
    reach = max(direction @ poses.p_box[n] + np.abs(direction @ poses.R_box[n]) @ field_links.half[n] for n in nodes)
    R = field_links.palm("right")[:3, :3]
    center = poses.p_box[nodes[-1]] + direction * (reach + gap + 0.01 - direction @ poses.p_box[nodes[-1]])
    return transform(center, R), np.array([0.01, 0.3, 0.3])


@pytest.mark.parametrize("norm", NORMS)
def test_equal_gaps_of_thumb_and_fingers_balance_only_when_grouped(norm) -> None:
    """The paper's first problem: one thumb and three fingers as far from the two faces of a box."""
    q = np.zeros(LAYOUT.dof)
    q[LAYOUT.arm("right")] = HOME
    sums = {}
    for mode in ("grouped", "summed"):
        links = LinkBoxes()
        links.update(q)
        obstacles = Obstacles(links)
        x = links.palm("right")[:3, 0]
        for group, direction in (("thumb", x), ("fingers", -x)):
            X, half = plate(links, group, direction, 0.01)
            obstacles.add(group, Kind.OBJECT, [OrientedBox(group, X, half)])
        field = Field(links, obstacles, FieldOptions(norm=norm, ties="hard", mode=mode))
        field.gains.reach[:] = 0.0
        for group in ("thumb", "fingers"):
            field.gains.reach[RIGHT, GROUPS.index(group), obstacles.index(group)] = 0.04
        sums[mode] = float(abs(field.evaluate().wrench[RIGHT, :3] @ x))
    assert sums["grouped"] < 0.05
    assert sums["summed"] > 1.0


def test_joints_feel_their_own_group_only() -> None:
    rng = np.random.default_rng(11)
    for _ in range(20):
        q = posture(rng)
        box, half = near_box(q, rng)
        field = build(q, box, half, FieldOptions())
        field.gains.reach[:, 2] = 0.0
        torque = field.evaluate().torque[RIGHT]
        assert np.all(torque[4:] == 0.0)
        field.gains.reach[:, 1:] = 0.0
        assert np.all(field.evaluate().torque[RIGHT] == 0.0)


def test_nothing_repels_beyond_its_range() -> None:
    q = posture(np.random.default_rng(1))
    field = build(q, transform((5.0, 0.0, 0.0)), np.full(3, 0.05), FieldOptions())
    field.gains.reach[:, :, :4] = 0.0
    results = field.evaluate()
    assert not results.wrench.any() and not results.torque.any() and np.all(np.isinf(results.distance))
    assert [reading.body for reading in field.readings("right")] == ["", "", ""]


def test_readings_tell_distance_point_and_force_of_each_group() -> None:
    q = np.zeros(LAYOUT.dof)
    q[LAYOUT.arm("right")] = HOME
    half = np.array([0.02, 0.03, 0.03])
    field = build(q, facing_palm(q, 0.015, np.zeros(3), half), half, FieldOptions())
    field.evaluate()
    palm, thumb, _ = field.readings("right")
    assert palm.body == "box" and palm.distance == pytest.approx(0.015, abs=1e-9)
    inward = -field.links.palm("right")[:3, 0]
    assert palm.force @ inward == pytest.approx(np.linalg.norm(palm.force))
    assert np.linalg.norm(palm.point - field.links.poses.p_box[hand_nodes("right").start]) < 0.04
    assert thumb.distance > 0.02


def test_repulsion_is_the_slope_of_its_energy_and_continuous() -> None:
    reach, k = 0.04, 2.5
    for d in np.linspace(-0.06, 0.06, 241) + 1e-5:
        slope = (repulsion(d + 1e-7, reach, k)[0] - repulsion(d - 1e-7, reach, k)[0]) / 2e-7
        assert repulsion(d, reach, k)[1] == pytest.approx(-slope, abs=1e-6)
    for d in (0.0, reach):
        assert repulsion(d - 1e-9, reach, k)[1] == pytest.approx(repulsion(d + 1e-9, reach, k)[1], abs=1e-6)


def test_attraction_is_the_slope_of_its_energy_and_bounded() -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        e = rng.normal(size=3) * rng.choice([0.01, 0.05, 0.3])
        force = attraction(e, 1.0, 0.05)
        ends = [[attraction_energy(e + s * u, 1.0, 0.05) for s in (1e-7, -1e-7)] for u in np.eye(3)]
        slope = np.array([(ahead - back) / 2e-7 for ahead, back in ends])
        np.testing.assert_allclose(force, slope, atol=1e-6)
        assert np.linalg.norm(force) <= 1.0 + 1e-12


def test_hand_reaches_a_free_goal_by_following_the_field() -> None:
    rng = np.random.default_rng(4)
    q = posture(rng)
    field = build(q, transform((5.0, 0.0, 0.0)), np.full(3, 0.05), FieldOptions())
    field.gains.reach[:] = 0.0
    field.evaluate()
    X = field.links.palm("right")
    goal = HandGoal(X @ transform((0.1, -0.05, 0.08), exp_so3([0.4, -0.3, 0.6])), np.full(13, 0.4))
    joints, dt = np.zeros(13), 0.01
    for _ in range(600):
        error, turn = pose_error(goal.X_world_palm, X)
        p = field.parameters
        v = p.base_mobility * attraction(error, p.pull_n, p.near_m)
        w = p.turn_mobility * attraction(turn, p.pull_nm, p.near_rad)
        X = transform(X[:3, 3] + dt * v, exp_so3(dt * w) @ X[:3, :3])
        joints = joints + dt * field.attraction(hand_error(goal, X, joints)).joints
    error, turn = pose_error(goal.X_world_palm, X)
    assert np.linalg.norm(error) < 1e-4 and np.linalg.norm(turn) < 1e-3
    np.testing.assert_allclose(joints, goal.joints, atol=1e-3)


def test_carried_twist_is_that_of_a_rigid_body() -> None:
    rng = np.random.default_rng(6)
    twist, p, r = rng.normal(size=6), rng.normal(size=3), rng.normal(size=3)
    dt = 1e-7
    there = p + dt * twist[:3] + exp_so3(dt * twist[3:]) @ (r - p)
    np.testing.assert_allclose(carried_twist(twist, p, r)[:3], (there - r) / dt, atol=1e-5)


def test_the_field_vanishes_at_the_goal_however_near_to_the_box_and_acts_before() -> None:
    q = posture(np.random.default_rng(8))
    half = np.array([0.02, 0.03, 0.03])
    field = build(q, facing_palm(q, 0.015, np.zeros(3), half), half, FieldOptions())
    goal = HandGoal(field.links.palm("right"), q[LAYOUT.hand("right")])
    clearance = goal_clearance(field, "right", goal)
    np.testing.assert_allclose(clearance[0, 4], 0.015, atol=1e-9)
    assert goal_error(hand_error(goal, field.links.palm("right"), goal.joints)) < 1e-9
    before = np.linalg.norm(field.evaluate().force[RIGHT, 0, 4])
    shorten_ranges(field, "right", clearance, 0.0)
    results = field.evaluate()
    assert before > 0.1 and not results.wrench[RIGHT].any() and not results.torque[RIGHT].any()
    shorten_ranges(field, "right", clearance, 0.1)
    assert np.linalg.norm(field.evaluate().force[RIGHT, 0, 4]) == pytest.approx(before)


def test_goal_clearance_is_what_the_field_measures_when_the_hand_is_there() -> None:
    rng = np.random.default_rng(13)
    for norm in NORMS:
        for _ in range(10):
            q = posture(rng)
            box, half = near_box(q, rng)
            field = build(q, box, half, FieldOptions(norm=norm))
            goal = HandGoal(field.links.palm("right"), q[LAYOUT.hand("right")])
            measured = field.evaluate().distance[RIGHT, :, 4]
            near = np.isfinite(measured)
            clearance = goal_clearance(field, "right", goal)[:, 4]
            np.testing.assert_allclose(clearance[near], np.maximum(measured[near], 0.0), atol=1e-9)
            assert np.all(clearance[~near] > field.parameters.range_m)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: FieldOptions(norm="l3"), "norm"),  # pyright: ignore[reportArgumentType]
        (lambda: FieldOptions(ties="loose"), "ties"),  # pyright: ignore[reportArgumentType]
        (lambda: FieldParameters(range_m=-1.0), "range_m"),
        (lambda: FieldParameters(pull_n=9.0), "strength_n"),
    ],
)
def test_bad_options_are_named(make, word) -> None:
    with pytest.raises(ValueError, match=word):
        make()
