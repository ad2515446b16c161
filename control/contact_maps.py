"""What contact forces do: wrench on the object, joint torques, load on each face of a box, sides of friction cones.

A force is given by its parts (n . f, u . f, v . f) along the contact's inward normal and two tangents: all maps are
linear in these, contact after contact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.control.grip_contacts import Contacts
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, face_normal
from preshape.planner.directions import square_to

CONE_SIDES = 8
"""Sides of the pyramid inside each friction cone: it understates friction by at most 8 %."""
LENGTH_M = 0.1
"""Moments count over this length beside forces."""
WRENCH_SCALE = np.r_[np.ones(3), np.full(3, 1.0 / LENGTH_M)]
"""Factors (6,) on a wrench in N and N m."""


@dataclass(frozen=True, slots=True)
class GripLimits:
    """What bounds the contact forces: friction coefficient, joint torques (13), N m, load on one face, N."""

    friction: float
    torque: Vector
    panel_n: float


@dataclass(frozen=True, slots=True, eq=False)
class ContactMaps:
    """Maps from the parts of n contacts' forces (3 n), N.

    `forces` (3 n, 3 n) in the contacts' frame; `wrenches` (6, 3 n) about its origin, by `WRENCH_SCALE`; `torques`
    (13, 3 n) of the joints that press so, N m; `pressing` (6, 3 n): load on each of `FACES`, N; `sides` (8 n, 3 n):
    not above 0 inside the friction cones.
    """

    forces: Matrix
    wrenches: Matrix
    torques: Matrix
    pressing: Matrix
    sides: Matrix


def contact_maps(contacts: Contacts, friction: float) -> ContactMaps:
    """Return the maps of a grip's contacts with a Coulomb friction coefficient."""
    count = len(contacts.points)
    axes = np.array([(n, *square_to(n)) for n in contacts.normals])
    forces = np.zeros((count, 3, count, 3))
    sides = np.zeros((count, CONE_SIDES, count, 3))
    angles = (np.arange(CONE_SIDES) + 0.5) * 2.0 * np.pi / CONE_SIDES
    reach = np.full(CONE_SIDES, -friction * np.cos(np.pi / CONE_SIDES))
    for i in range(count):
        forces[i, :, i, :] = axes[i].T
        sides[i, :, i, :] = np.column_stack([reach, np.cos(angles), np.sin(angles)])
    moments = np.cross(np.repeat(contacts.points, 3, axis=0), axes.reshape(-1, 3))
    pressing = np.zeros((len(FACES), count, 3))
    pressing[:, :, 0] = np.maximum(-np.array([face_normal(face) for face in FACES]) @ contacts.normals.T, 0.0)
    return ContactMaps(
        forces.reshape(3 * count, 3 * count),
        np.hstack([axes.reshape(-1, 3), moments]).T * WRENCH_SCALE[:, None],
        np.einsum("iaj,ika->jik", contacts.jacobians, axes).reshape(-1, 3 * count),
        pressing.reshape(-1, 3 * count),
        sides.reshape(-1, 3 * count),
    )
