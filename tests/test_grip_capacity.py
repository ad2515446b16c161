"""What a grip bears: contacts on the box's surface, the linear program against another solver and by hand."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from preshape.control.contact_maps import CONE_SIDES, GripLimits
from preshape.control.grip import Grip
from preshape.control.grip_contacts import TOUCHING_M, Contacts, grip_contacts
from preshape.control.grips import brace_grip, cage_grip
from preshape.hal.layout import LAYOUT
from preshape.hal.sah_hand import PARTS
from preshape.hal.transform import transform
from preshape.hal.world import FACES, Face, face_normal
from preshape.planner.directions import square_to
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.tools.grip_capacity import capacity, push_at

SIZE = np.array([0.06, 0.09, 0.20])
BRACES: list[tuple[Face, Face]] = [(end, face) for end in ("+z", "-z") for face in ("+x", "-x")]
NO_WEIGHT = np.zeros(6)


def _grips() -> list[Grip]:
    braces = [brace_grip(SIZE, end, face, "left") for end, face in BRACES]
    return [*braces, cage_grip(SIZE, "+z", "+y", "right"), cage_grip(SIZE, "-z", "-y", "left")]


@pytest.mark.parametrize("grip", _grips(), ids=lambda grip: f"{grip.name}-{grip.side}")
def test_contacts_lie_on_the_surface_and_press_inward(grip: Grip) -> None:
    contacts = grip_contacts(grip, SIZE)
    assert np.abs(np.abs(contacts.points) - SIZE / 2).min(axis=1).max() < 1e-9
    assert (np.abs(contacts.points) <= SIZE / 2 + 1e-9).all()
    inside = contacts.points + 1e-4 * contacts.normals
    assert (np.abs(inside) < SIZE / 2 + 1e-9).all()
    assert np.linalg.norm(contacts.normals, axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize("grip", _grips(), ids=lambda grip: f"{grip.name}-{grip.side}")
def test_every_driven_finger_touches_and_joints_keep_their_limits(grip: Grip) -> None:
    contacts = grip_contacts(grip, SIZE)
    touching = {part.split("_")[0] for part in contacts.parts}
    assert {finger for pair in grip.opposed for finger in pair} <= touching
    hand = LAYOUT.hand(grip.side)
    assert (contacts.angles >= LAYOUT.lower[hand] - 0.011).all()
    assert (contacts.angles <= LAYOUT.upper[hand] + 0.011).all()


@pytest.mark.parametrize(("end", "face"), BRACES)
def test_a_brace_leaves_the_opening_face_free(end: Face, face: Face) -> None:
    contacts = grip_contacts(brace_grip(SIZE, end, face, "left"), SIZE)
    depth = SIZE @ np.abs(face_normal(face)) / 2 - contacts.points @ face_normal(face)
    assert depth.min() > 2 * TOUCHING_M or not (contacts.normals @ face_normal(face) < -0.1).any()


def test_jacobians_are_the_derivatives_of_points_fixed_to_their_parts() -> None:
    grip = brace_grip(SIZE, "-z", "+x", "left")
    contacts, kinematics = grip_contacts(grip, SIZE), hand_kinematics("left")
    R, p, step = grip.X_box_palm[:3, :3], grip.X_box_palm[:3, 3], 1e-6

    def at(q: NDArray[np.float64], part: int, p_part: NDArray[np.float64]) -> NDArray[np.float64]:
        X = kinematics.part_poses(q)[part]
        return R @ (X[:3, :3] @ p_part + X[:3, 3]) + p

    for point, J, name in zip(contacts.points, contacts.jacobians, contacts.parts, strict=True):
        part = list(PARTS).index(name)
        X = kinematics.part_poses(contacts.angles)[part]
        p_part = X[:3, :3].T @ (R.T @ (point - p) - X[:3, 3])
        for joint in range(len(contacts.angles)):
            dq = np.eye(len(contacts.angles))[joint] * step
            moved = at(contacts.angles + dq, part, p_part) - at(contacts.angles - dq, part, p_part)
            assert moved / (2 * step) == pytest.approx(J[:, joint], abs=1e-7)


def test_a_finger_that_finds_nothing_is_named() -> None:
    grip = cage_grip(SIZE, "+z", "+y", "right")
    far = replace(grip, X_box_palm=transform((0.0, 0.0, 1.0)) @ grip.X_box_palm)
    with pytest.raises(ValueError, match="thumb_flex: finds nothing to touch"):
        grip_contacts(far, SIZE)


def _pinch(count: int = 2) -> Contacts:
    """Return point contacts in the middle of the +y and -y faces, which no joint bears."""
    normals = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])[:count]
    return Contacts(-normals * SIZE / 2, normals, np.zeros((count, 3, 13)), ("thumb_dist", "fore_dist"), np.zeros(13))


@pytest.mark.parametrize("friction", [0.3, 0.7])
def test_a_pinch_bears_twice_friction_times_what_the_faces_bear(friction: float) -> None:
    u, _ = square_to(np.array([0.0, 1.0, 0.0]))
    load = push_at(np.zeros(3), u)
    got = capacity(_pinch(), load, NO_WEIGHT, GripLimits(friction, np.ones(13), 25.0))
    assert got == pytest.approx(2 * friction * 25.0, rel=1e-4)


def test_a_pinch_cannot_bear_a_turn_about_its_own_line_nor_a_single_contact_anything() -> None:
    limits = GripLimits(0.8, np.ones(13), 25.0)
    turn = push_at(np.array([0.03, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    turn -= push_at(np.array([-0.03, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    assert capacity(_pinch(), turn, NO_WEIGHT, limits) == pytest.approx(0.0, abs=1e-6)
    assert capacity(_pinch(1), push_at(np.zeros(3), [0, 0, 1.0]), NO_WEIGHT, limits) == pytest.approx(0.0, abs=1e-6)


def test_a_weight_beyond_the_grip_leaves_nothing() -> None:
    limits = GripLimits(0.5, np.ones(13), 25.0)
    load = push_at(np.zeros(3), np.array([0.0, 0.0, -1.0]))
    assert capacity(_pinch(), load, load * 30.0, limits) == 0.0
    assert capacity(_pinch(), load, load * 10.0, limits) > 5.0


def _another(contacts: Contacts, load: NDArray[np.float64], weight: NDArray[np.float64], limits: GripLimits) -> float:
    """Solve the same program over contact forces (3 a contact) with scipy, cones as half spaces of their edges."""
    n = len(contacts.points)
    balance, torque, press = np.zeros((6, 3 * n + 1)), np.zeros((13, 3 * n + 1)), np.zeros((6, 3 * n + 1))
    cones: list[NDArray[np.float64]] = []
    for i, (p, normal, J) in enumerate(zip(contacts.points, contacts.normals, contacts.jacobians, strict=True)):
        own = slice(3 * i, 3 * i + 3)
        balance[:3, own] = np.eye(3)
        balance[3:, own] = np.cross(np.eye(3), p).T * -1.0
        torque[:, own] = J.T
        for k, face in enumerate(FACES):
            press[k, own] = max(float(normal @ -face_normal(face)), 0.0) * normal
        u, v = square_to(normal)
        a = (np.arange(CONE_SIDES) + 0.5) * 2 * np.pi / CONE_SIDES
        sides = np.outer(np.cos(a), u) + np.outer(np.sin(a), v) - limits.friction * np.cos(np.pi / CONE_SIDES) * normal
        rows = np.zeros((CONE_SIDES, 3 * n + 1))
        rows[:, own] = sides
        cones.append(rows)
    balance[:, -1] = load
    A = np.vstack([*cones, torque, -torque, press])
    b = np.r_[np.zeros(n * CONE_SIDES), limits.torque, limits.torque, np.full(6, limits.panel_n)]
    bounds = [(None, None)] * (3 * n) + [(0.0, 200.0)]
    found = linprog(np.r_[np.zeros(3 * n), -1.0], A, b, balance, -weight, bounds, method="highs")
    return float(found.x[-1]) if found.success else 0.0


@pytest.mark.parametrize("seed", range(20))
def test_equals_another_solver_on_real_grips_and_random_loads(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grip = _grips()[seed % 6]
    contacts = grip_contacts(grip, SIZE)
    load = push_at(rng.uniform(-1, 1, 3) * SIZE / 2, rng.normal(size=3))
    weight = push_at(np.zeros(3), rng.normal(size=3)) * 0.5
    limits = GripLimits(rng.uniform(0.4, 0.9), LAYOUT.torque[LAYOUT.hand(grip.side)] * rng.uniform(0.5, 1.0), 25.0)
    wanted = _another(contacts, load, weight, limits)
    assert capacity(contacts, load, weight, limits) == pytest.approx(wanted, rel=2e-3, abs=2e-3)


def test_more_friction_torque_or_crush_load_never_bear_less() -> None:
    contacts = grip_contacts(brace_grip(SIZE, "-z", "+x", "left"), SIZE)
    load = push_at(np.array([0.03, 0.02, 0.0]), np.array([-1.0, 0.0, 0.0]))
    weight = push_at(np.zeros(3), np.array([0.0, -1.5, 0.0]))
    torque = LAYOUT.torque[LAYOUT.hand("left")]
    weak = capacity(contacts, load, weight, GripLimits(0.5, 0.5 * torque, 15.0))
    assert weak > 0.0
    for stronger in (
        GripLimits(0.7, 0.5 * torque, 15.0),
        GripLimits(0.5, torque, 15.0),
        GripLimits(0.5, 0.5 * torque, 25.0),
    ):
        assert capacity(contacts, load, weight, stronger) >= weak - 1e-3


def test_twice_the_unit_load_is_borne_half_as_often() -> None:
    contacts = grip_contacts(brace_grip(SIZE, "+z", "-x", "left"), SIZE)
    load = push_at(np.array([-0.03, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    limits = GripLimits(0.6, LAYOUT.torque[LAYOUT.hand("left")], 25.0)
    once, twice = (capacity(contacts, factor * load, NO_WEIGHT, limits) for factor in (1.0, 2.0))
    assert twice == pytest.approx(once / 2, rel=1e-3)
