"""Does the grip that holds the box while it is opened bear what opening asks? Capacity beside demand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from preshape.control.contact_maps import GripLimits
from preshape.control.grip_contacts import Contacts, grip_contacts
from preshape.control.grips import brace_grip
from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector
from preshape.hal.world import FACES, Face
from preshape.sim_backend.scenario import Scenario
from preshape.tools.grip_capacity import capacity, push_at
from preshape.tools.opening_demand import Demand, demands

FRICTIONS = (0.4, 0.5, 0.6, 0.8)
SCALES = (0.5, 1.0, 2.0)
"""Factors on all strengths that results are published at."""
GRAVITY = 9.81
Verdict = Literal["holds", "at limits", "no"]


@dataclass(frozen=True, slots=True)
class Holding:
    """One load at one friction and one factor on the strengths, N.

    `held_n`: what the grip bears with its driven joints at their holding torques at most; `limit_n`: with every
    joint up to its torque limit; both with no more load on any face than crushes it, and for the worst way the
    box may be turned about its horizontal axis.
    """

    load: str
    friction: float
    scale: float
    demand_n: float
    held_n: float
    limit_n: float

    @property
    def verdict(self) -> Verdict:
        """Whether holding torques suffice, or only the torque limits do, or the grip must lose the box."""
        if self.held_n >= self.demand_n:
            return "holds"
        return "at limits" if self.limit_n >= self.demand_n else "no"


@dataclass(frozen=True, slots=True, eq=False)
class _Held:
    """The box in one grip: contacts, the wrench of its weight for each way it may be turned, torques (13), N m."""

    contacts: Contacts
    weights: list[Vector]
    torques: tuple[Vector, Vector]

    def bears(self, demand: Demand, friction: float, crush_n: float) -> Vector:
        """Return how much of a load it bears at holding torques and at the torque limits (2,), N."""
        limits = [GripLimits(friction, torque, crush_n) for torque in self.torques]
        return np.array(
            [min(capacity(self.contacts, demand.wrench, w, limit) for w in self.weights) for limit in limits]
        )


def _held(scenario: Scenario, end: Face) -> _Held:
    box, size = scenario.box, np.array(scenario.box.size_m)
    grip = brace_grip(size, end, scenario.opening.face, "left")
    full = LAYOUT.torque[LAYOUT.hand("left")]
    driven = np.isfinite(grip.torques)
    across = [sign * grip.X_box_palm[:3, axis] for axis in (0, 1) for sign in (-1.0, 1.0)]
    return _Held(
        grip_contacts(grip, size),
        [push_at(box.center_of_mass_m, down) * box.mass_kg * GRAVITY for down in across],
        (np.where(driven, np.abs(np.nan_to_num(grip.torques)), full), full),
    )


def holding_check(scenario: Scenario) -> list[Holding]:
    """Return capacity beside demand of a drawn scenario's box, held by either end cap, the weaker counting.

    Raises:
        ValueError: no grip leaves the opening face free at this size, with the reason.
    """
    long_axis = int(np.argmax(scenario.box.size_m))
    ends = [_held(scenario, face) for face in FACES if "xyz".index(face[1]) == long_axis]
    rows: list[Holding] = []
    for scale in SCALES:
        strengths = msgspec.structs.replace(scenario.strengths, scale=scale)
        for demand in demands(msgspec.structs.replace(scenario, strengths=strengths)):
            for friction in FRICTIONS:
                borne = [end.bears(demand, friction, strengths.crush_n * scale) for end in ends]
                held_n, limit_n = np.min(borne, axis=0)
                rows.append(Holding(demand.name, friction, scale, demand.newton, float(held_n), float(limit_n)))
    return rows
