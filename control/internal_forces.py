"""The torques of a squeeze: internal forces of a grip's contacts, by a small QP (paper, end of section IV).

    min  sum_i (n_i . f_i)^2 + |t_i f_i|^2 / mu_0^2  +  W (s - S)^2,    s = sum over the thumb of n_i . f_i,
    subject to   sum_i G_i f_i = 0,    f_i inside its friction cone,    |sum_i J_i^T f_i| <= share of the torque limits,
                 normal force on each face <= S,     each finger opposite the thumb >= a share of s / their number,

f_i the force of contact i on the object, n_i its inward normal, t_i its tangents, G_i its wrench map, S the share of
what a panel bears. W is so large that the squeeze s is as strong as joints and panels allow; mu_0 is so far below the
real friction that the normal forces balance nearly alone: what friction there is is left to loads. The joints' torques
are tau = sum_i J_i^T f_i. Such forces balance by themselves: no other hand has to bear a rest of them, and the object
stays where it is when that hand lets go.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import daqp
import numpy as np

from preshape.control.contact_maps import GripLimits, contact_maps
from preshape.control.grip import Grip, Stage
from preshape.control.grip_contacts import Contacts, grip_contacts
from preshape.hal.layout import LAYOUT, Side
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix

PANEL_N = 12.0
"""Load of the squeeze on any face, N: half of what a panel bears; the rest is left to what the box is held for."""
FRICTION = 0.4
"""The least friction that there is."""
SPARED_FRICTION = 0.05
"""mu_0: from here on friction costs more than normal force."""
JOINT_SHARE = 0.85
"""Share of its torque limit that the squeeze may ask of any joint."""
LEAST_SHARE = 2.0 / 3.0
"""Share of an even part of the squeeze that each finger opposite the thumb bears at least: none of them is idle."""
LEAST_SQUEEZE_N = 1.0
"""Contacts that balance with less than this do not hold anything, N."""
_WISH = 1e4
_EQUAL = 5
_MOST_N = 1e3


def squeeze_limits(side: Side) -> GripLimits:
    """Return what bounds a squeeze of one hand."""
    return GripLimits(FRICTION, JOINT_SHARE * LAYOUT.torque[LAYOUT.hand(side)], PANEL_N)


def internal_forces(contacts: Contacts, opposite: Sequence[str], limits: GripLimits) -> Matrix:
    """Return the contacts' forces on the object (n, 3), N, in the contacts' frame.

    `opposite` names the fingers that press against the thumb. `ValueError` if no forces of these contacts balance.
    """
    maps = contact_maps(contacts, limits.friction)
    price = np.tile((1.0, 1.0 / SPARED_FRICTION, 1.0 / SPARED_FRICTION), len(contacts.points))
    thumb = _pressing(contacts, "thumb")
    shares = np.array([_pressing(contacts, finger) - LEAST_SHARE / len(opposite) * thumb for finger in opposite])
    rows = np.vstack([maps.wrenches, maps.sides, maps.torques, maps.pressing, shares])
    inside, faces, fingers = np.zeros(len(maps.sides)), np.zeros(len(maps.pressing)), np.zeros(len(opposite))
    sense = np.zeros(len(rows), dtype=np.int32)
    sense[:6] = _EQUAL
    parts, _, status, _ = daqp.solve(
        np.diag(price**2) + _WISH * np.outer(thumb, thumb),
        -_WISH * limits.panel_n * thumb,
        rows,
        np.r_[np.zeros(6), inside, limits.torque, faces + limits.panel_n, fingers + _MOST_N],
        np.r_[np.zeros(6), inside - _MOST_N, -limits.torque, faces, fingers],
        sense,
    )
    if status <= 0 or thumb @ parts < LEAST_SQUEEZE_N:
        raise ValueError(f"thumb, {', '.join(opposite)}: no forces of these fingers balance on the object")
    return (maps.forces @ parts).reshape(-1, 3)


def _pressing(contacts: Contacts, finger: str) -> Vector:
    """Return the map (3 n,) from the parts of the contacts' forces to what a finger presses, N."""
    row = np.zeros((len(contacts.parts), 3))
    row[:, 0] = [part.startswith(f"{finger}_") for part in contacts.parts]
    return row.ravel()


def squeezed(shape: Grip, size: Matrix) -> Grip:
    """Return a grip of a box of outer size (3,), m, with the torques (N m) of its squeeze.

    The shape's torques say which joints are driven and in which direction (+-1); those of its stages which share of
    the squeeze a stage asks for. `ValueError` if a joint would have to be driven the other way.
    """
    return pressed(shape, grip_contacts(shape, size))


def pressed(shape: Grip, contacts: Contacts) -> Grip:
    """Return a grip with the torques (N m) of its squeeze at these contacts; see `squeezed`."""
    opposite = [pair[1] for pair in shape.opposed if pair[0] == "thumb"]
    forces = internal_forces(contacts, opposite, squeeze_limits(shape.side))
    torques = np.einsum("ijk,ij->k", contacts.jacobians, forces) * np.sign(shape.torques)
    if np.any(torques <= 0.0):
        raise ValueError(f"{shape.name}: its fingers do not press on what lies between them")
    stages = tuple(Stage(s.angles, s.torques * torques, s.seconds, s.touch) for s in shape.stages)
    return replace(shape, stages=stages, torques=shape.torques * torques)
