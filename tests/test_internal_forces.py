"""Laws of internal forces: they balance, hold within every limit, and none that do press as hard with less friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from preshape.control.contact_maps import GripLimits, contact_maps
from preshape.control.grip import Grip
from preshape.control.grip_contacts import Contacts, grip_contacts
from preshape.control.grips import CLAMP_WIDTHS, GRASP_WIDTHS, SPARE_M, brace_grip, cage_grip
from preshape.control.internal_forces import (
    LEAST_SHARE,
    PANEL_N,
    SPARED_FRICTION,
    internal_forces,
    pressed,
    squeeze_limits,
)
from preshape.control.straddle_grip import HEIGHTS, WIDTHS, straddle_grip
from preshape.hal.layout import HAND_DOF, LAYOUT
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, face_normal

SIZE = np.array([0.06, 0.09, 0.20])
GRIPS = [
    brace_grip(SIZE, "-z", "+x", "left"),
    brace_grip(SIZE, "+z", "-x", "left", SPARE_M),
    brace_grip(SIZE, "+z", "-x", "right"),
    cage_grip(SIZE, "+z", "+y", "right"),
    cage_grip(SIZE, "-z", "-y", "left"),
    straddle_grip(SIZE, "+x", "+y", "+z"),
]
each_grip = pytest.mark.parametrize("grip", GRIPS, ids=lambda grip: f"{grip.name}-{grip.side}")


def opposite(grip: Grip) -> list[str]:
    return [finger for first, finger in grip.opposed if first == "thumb"]


def solved(grip: Grip, limits: GripLimits | None = None) -> tuple[Contacts, Matrix]:
    contacts = grip_contacts(grip, SIZE)
    return contacts, internal_forces(contacts, opposite(grip), limits or squeeze_limits(grip.side))


def along_normals(contacts: Contacts, forces: Matrix) -> Vector:
    return np.einsum("ij,ij->i", contacts.normals, forces)


def pressed_by(contacts: Contacts, forces: Matrix, finger: str) -> float:
    own = [part.startswith(f"{finger}_") for part in contacts.parts]
    return float(along_normals(contacts, forces)[own].sum())


@each_grip
def test_internal_forces_move_nothing(grip: Grip) -> None:
    contacts, forces = solved(grip)
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-5)
    np.testing.assert_allclose(np.cross(contacts.points, forces).sum(axis=0), 0.0, atol=1e-6)


@each_grip
def test_they_keep_to_friction_drives_and_panels(grip: Grip) -> None:
    contacts, forces = solved(grip)
    limits, normal = squeeze_limits(grip.side), along_normals(contacts, forces)
    tangential = np.linalg.norm(forces - normal[:, None] * contacts.normals, axis=1)
    assert np.all(tangential <= limits.friction * normal + 1e-5)
    torques = np.einsum("ijk,ij->k", contacts.jacobians, forces)
    assert np.all(np.abs(torques) <= limits.torque + 1e-6)
    for face in FACES:
        assert np.maximum(-contacts.normals @ face_normal(face), 0.0) @ normal <= limits.panel_n + 1e-4


@each_grip
def test_the_squeeze_is_as_strong_as_joints_and_panels_allow_and_no_finger_is_idle(grip: Grip) -> None:
    contacts, forces = solved(grip)
    squeeze, fingers = pressed_by(contacts, forces, "thumb"), opposite(grip)
    torques = np.abs(np.einsum("ijk,ij->k", contacts.jacobians, forces)) / squeeze_limits(grip.side).torque
    assert squeeze == pytest.approx(PANEL_N, rel=2e-3) or float(torques.max()) == pytest.approx(1.0, abs=1e-4)
    for finger in fingers:
        assert pressed_by(contacts, forces, finger) >= LEAST_SHARE * squeeze / len(fingers) - 1e-4


@each_grip
def test_no_other_forces_that_keep_to_the_limits_and_squeeze_as_hard_cost_less(grip: Grip) -> None:
    """The cost is convex: where no step that keeps to the limits goes downhill, none costs less. A linear program."""
    contacts, forces = solved(grip)
    limits, maps = squeeze_limits(grip.side), contact_maps(contacts, squeeze_limits(grip.side).friction)
    parts, fingers = maps.forces.T @ forces.ravel(), opposite(grip)
    slope = 2.0 * parts * np.tile((1.0, SPARED_FRICTION**-2.0, SPARED_FRICTION**-2.0), len(contacts.points))
    names = np.array([part.split("_")[0] for part in contacts.parts])
    rows = {name: np.repeat(names == name, 3) * np.tile((1.0, 0.0, 0.0), len(names)) for name in ("thumb", *fingers)}
    squeeze = rows["thumb"] @ parts
    shares = np.array([LEAST_SHARE / len(fingers) * rows["thumb"] - rows[finger] for finger in fingers])
    A = np.vstack([maps.sides, maps.torques, -maps.torques, maps.pressing, shares])
    b = np.r_[np.zeros(len(maps.sides)), limits.torque, limits.torque, np.full(6, PANEL_N), np.zeros(len(fingers))]
    best = linprog(
        slope, A, np.maximum(b, A @ parts), np.vstack([maps.wrenches, rows["thumb"]]),
        np.r_[maps.wrenches @ parts, squeeze], bounds=(None, None),
    )  # fmt: skip
    assert best.status == 0
    assert slope @ parts - best.fun <= 1e-3 * (slope @ parts)


@each_grip
@given(share=st.floats(0.2, 0.6))
@settings(max_examples=8, deadline=None)
def test_weaker_drives_squeeze_in_proportion(grip: Grip, share: float) -> None:
    limits = squeeze_limits(grip.side)
    weak = GripLimits(limits.friction, share * limits.torque, limits.panel_n)
    half = GripLimits(limits.friction, 0.5 * share * limits.torque, limits.panel_n)
    contacts, forces = solved(grip, weak)
    full, less = (pressed_by(contacts, f, "thumb") for f in (forces, solved(grip, half)[1]))
    assert less == pytest.approx(0.5 * full, rel=0.02)


def test_fingers_that_all_press_from_one_side_are_refused() -> None:
    contacts = Contacts(
        np.array([[0.03, 0.0, 0.0], [0.03, 0.02, 0.0]]),
        np.array([[-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]),
        np.zeros((2, 3, HAND_DOF)),
        ("thumb_dist", "fore_dist"),
        np.zeros(HAND_DOF),
    )
    with pytest.raises(ValueError, match="thumb, fore: no forces"):
        internal_forces(contacts, ["fore"], GripLimits(0.4, np.ones(HAND_DOF), PANEL_N))


def widths(allowed: tuple[float, float]) -> st.SearchStrategy[float]:
    return st.floats(allowed[0] + 1e-6, allowed[1] - 1e-6)


@given(thickness=widths(CLAMP_WIDTHS), width=widths(GRASP_WIDTHS), length=st.floats(0.16, 0.26))
@settings(max_examples=30, deadline=None)
def test_every_box_that_a_grip_suits_is_squeezed_by_all_its_fingers(
    thickness: float, width: float, length: float
) -> None:
    size = np.array([thickness, width, length])
    limit = LAYOUT.torque[LAYOUT.hand("left")]
    for grip in (
        cage_grip(size, "+z", "-y", "right"),
        brace_grip(size, "-z", "+x", "left"),
        brace_grip(size, "+z", "+x", "left", SPARE_M),
    ):
        driven = np.isfinite(grip.torques)
        assert np.all(np.abs(grip.torques[driven]) > 0.05)
        assert np.all(np.abs(grip.torques[driven]) < limit[driven])


@given(height=widths(HEIGHTS), width=widths(WIDTHS), length=st.floats(0.18, 0.22))
@settings(max_examples=15, deadline=None)
def test_every_lying_box_that_the_straddle_suits_is_squeezed_by_all_its_fingers(
    height: float, width: float, length: float
) -> None:
    grip = straddle_grip(np.array([height, width, length]), "+x", "+y", "+z")
    assert np.all(grip.torques[np.isfinite(grip.torques)] > 0.1)


def test_a_grip_whose_fingers_press_away_from_the_box_is_refused() -> None:
    grip = GRIPS[0]
    away = replace(grip, torques=-np.sign(grip.torques))
    with pytest.raises(ValueError, match="brace: its fingers do not press"):
        pressed(away, grip_contacts(grip, SIZE))
