"""How hard a box may be pushed before a grip must lose it: a linear program over contact forces.

    max  load   subject to   sum_i G_i f_i + load w + g = 0,    f_i inside its friction cone,
                             |sum_i J_i^T f_i| <= torque,       normal force on each face <= crush load,

f_i the force of contact i on the box, G_i its wrench map about the box's centre, w the wrench of 1 N of load,
g that of the weight. Every set of inner forces that friction, drives and cardboard allow is taken to be at hand:
the program is an upper bound, what a controller that regulates the squeeze can use at best.
"""

from __future__ import annotations

from dataclasses import dataclass

import daqp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, face_normal
from preshape.planner.directions import square_to
from preshape.tools.grip_contacts import Contacts

CONE_EDGES = 8
"""Edges of the pyramid inside each friction cone: it understates friction by at most 8 %."""
MOST_LOAD_N = 200.0
"""No load above this is looked for."""
_LENGTH = 0.1
_SMALL = 1e-8


@dataclass(frozen=True, slots=True)
class GripLimits:
    """What bounds the contact forces: friction coefficient, joint torques (13), N m, load on one face, N."""

    friction: float
    torque: Vector
    crush_n: float


def push_at(p: ArrayLike, direction: ArrayLike) -> Vector:
    """Return the wrench (6,) about the box's centre of 1 N at p (box frame, m)."""
    force = np.asarray(direction, float)
    return np.concatenate([force, np.cross(np.asarray(p, float), force)])


def _edges(contacts: Contacts, friction: float) -> tuple[Matrix, NDArray[np.intp]]:
    """Return the pyramids' edges, each with a normal part of 1 N, (m, 3), and the contact of each (m,)."""
    angles = np.arange(CONE_EDGES) * 2.0 * np.pi / CONE_EDGES
    edges: list[Matrix] = []
    for normal in contacts.normals:
        u, v = square_to(normal)
        edges.append(normal + friction * (np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)))
    return np.vstack(edges), np.repeat(np.arange(len(contacts.points), dtype=np.intp), CONE_EDGES)


def capacity(contacts: Contacts, load: Vector, weight: Vector, limits: GripLimits) -> float:
    """Return the largest multiple (N) of the unit load wrench (6,) that the grip can bear beside a weight's wrench.

    0 when it cannot even bear the weight; `MOST_LOAD_N` at most.
    """
    edges, at = _edges(contacts, limits.friction)
    points, J = contacts.points[at], contacts.jacobians[at]
    scale = np.r_[np.ones(3), np.full(3, 1.0 / _LENGTH)]
    wrenches = np.hstack([edges, np.cross(points, edges)]) * scale
    torques = np.einsum("ijk,ij->ik", J, edges)
    pressing = np.array([np.maximum(contacts.normals[at] @ -face_normal(face), 0.0) for face in FACES])
    rows = np.vstack([np.c_[wrenches.T, load * scale], np.c_[torques.T, np.zeros(len(limits.torque))],
                      np.c_[pressing, np.zeros(len(FACES))]])  # fmt: skip
    upper = np.r_[-weight * scale, limits.torque, np.full(len(FACES), limits.crush_n)]
    lower = np.r_[-weight * scale, -limits.torque, np.zeros(len(FACES))]
    count = len(edges) + 1
    bounds = np.r_[np.full(len(edges), 1e3), MOST_LOAD_N], np.zeros(count)
    sense = np.zeros(count + len(rows), dtype=np.int32)
    sense[count : count + 6] = 5
    goal = np.r_[np.zeros(len(edges)), -1.0]
    x, _, status, _ = daqp.solve(
        np.eye(count) * _SMALL,
        goal,
        np.ascontiguousarray(rows),
        np.r_[bounds[0], upper],
        np.r_[bounds[1], lower],
        sense,
    )
    return float(x[-1]) if status > 0 else 0.0
