"""How hard a box may be pushed before a grip must lose it: a linear program over contact forces.

    max  load   subject to   sum_i G_i f_i + load w + g = 0,    f_i inside its friction cone,
                             |sum_i J_i^T f_i| <= torque,       normal force on each face <= crush load,

f_i the force of contact i on the box, G_i its wrench map about the box's centre, w the wrench of 1 N of load,
g that of the weight. Every set of inner forces that friction, drives and cardboard allow is taken to be at hand:
the program is an upper bound, what a controller that regulates the squeeze can use at best.
"""

from __future__ import annotations

import daqp
import numpy as np
from numpy.typing import ArrayLike

from preshape.control.contact_maps import WRENCH_SCALE, GripLimits, contact_maps
from preshape.control.grip_contacts import Contacts
from preshape.hal.state import Vector
from preshape.hal.transform import cross

MOST_LOAD_N = 200.0
"""No load above this is looked for."""
_MOST_N = 1e3
_SMALL = 1e-8


def push_at(p: ArrayLike, direction: ArrayLike) -> Vector:
    """Return the wrench (6,) about the box's centre of 1 N at p (box frame, m)."""
    force = np.asarray(direction, float)
    return np.concatenate([force, cross(p, force)])


def capacity(contacts: Contacts, load: Vector, weight: Vector, limits: GripLimits) -> float:
    """Return the largest multiple (N) of the unit load wrench (6,) that the grip can bear beside a weight's wrench.

    0 when it cannot even bear the weight; `MOST_LOAD_N` at most.
    """
    maps = contact_maps(contacts, limits.friction)
    count, faces = maps.wrenches.shape[1] + 1, np.zeros(len(maps.pressing))
    weight, load, inside = weight * WRENCH_SCALE, load * WRENCH_SCALE, np.zeros(len(maps.sides))
    loads = np.r_[load, np.zeros(len(inside) + len(limits.torque) + len(faces))]
    rows = np.c_[np.vstack([maps.wrenches, maps.sides, maps.torques, maps.pressing]), loads]
    sense = np.zeros(count + len(rows), dtype=np.int32)
    sense[count : count + 6] = 5
    x, _, status, _ = daqp.solve(
        np.eye(count) * _SMALL,
        np.r_[np.zeros(count - 1), -1.0],
        np.ascontiguousarray(rows),
        np.r_[np.full(count - 1, _MOST_N), MOST_LOAD_N, -weight, inside, limits.torque, faces + limits.panel_n],
        np.r_[np.full(count - 1, -_MOST_N), 0.0, -weight, inside - _MOST_N, -limits.torque, faces],
        sense,
    )
    return float(x[-1]) if status > 0 else 0.0
