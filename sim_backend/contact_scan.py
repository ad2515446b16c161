"""One pass over all contacts of a physics step: forbidden pairs, who touches the box, loads, sliding."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled
from preshape.hal.layout import SIDES
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, face_normal
from preshape.sim_backend.contact_rules import (
    CLASS,
    PARTS,
    RULES,
    Rules,
    contact_table,
    geom_classes,
    hand,
    hand_links,
)
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.solid_object import corners

Indices = NDArray[Any]

RIM_M = 0.015
"""Points of the shell this near to the opening face's plane are its rim, m."""
SIDE_COSINE = 0.3
"""A contact on the lid is on its inner or outer side if its normal has at least this share along the lid's."""
LINKS = len(SIDES) * len(PARTS)

RIGHT_ON_BOX, LEFT_ON_BOX, TABLE_ON_BOX, OTHER_ON_BOX = 1, 2, 4, 8
RIGHT_ON_LID, THUMB_ON_TAB, THUMB_INSIDE, FINGER_OUTSIDE = 16, 32, 64, 128
"""Bits of what one step's contacts say; lid contacts here include the tab's, except for the last two."""

_NONE: Indices = np.zeros((0, 3), dtype=np.int64)
_RIGHT_FIRST, _RIGHT_LAST = CLASS[hand("right")[0]], CLASS[hand("right")[-1]]
_LEFT_FIRST, _LEFT_LAST = CLASS[hand("left")[0]], CLASS[hand("left")[-1]]
_TABLE, _THUMB = CLASS["table"], CLASS["right_thumb"]
_SHELL, _RIM, _LID, _TAB = CLASS["shell"], CLASS["rim"], CLASS["lid"], CLASS["tab"]


class ContactScan:
    """Scans the contacts of each step of one model; the results live in arrays that each `scan` overwrites.

    `face_load` (6,): force into each face of the box, N, in the order of FACES. `link_load` (36,): normal force
    of each hand part on the box, N. `link_slide` (36, 3): load-weighted mean tangential velocity of the hand part
    against the box at its contacts, in the box's frame, m/s. `lowest` m: height of the object's lowest corner.
    """

    def __init__(self, model: mujoco.MjModel, scenario: Scenario, rules: Rules = RULES) -> None:
        """Prepare lookups for a model built from a drawn scenario, and the rules of who may touch whom."""
        self._box = model.body("box").id
        self._lid = next((b for b in range(model.nbody) if model.body(b).name == "lid"), self._box)
        self._classes, self._links = geom_classes(model), hand_links(model)
        self._table = contact_table(rules)
        self._seen = np.zeros((model.ngeom, model.ngeom), dtype=np.uint8)
        self._fresh = np.zeros((32, 3), dtype=np.int64)
        self._half = np.array(scenario.box.size_m) / 2
        self._corners = corners(scenario)
        self._opening = face_normal(scenario.opening.face)
        self.face_load = np.zeros(len(FACES))
        self.link_load = np.zeros(LINKS)
        self.link_slide = np.zeros((LINKS, 3))
        self.lowest = 0.0

    def scan(self, data: mujoco.MjData, stage: int, lid_shut: bool) -> tuple[int, Indices]:
        """Return the touch bits and the pairs (geom, geom, kind) not allowed in this stage and seen for the first time.

        While the lid is shut its contacts load the box like the shell's.
        """
        contact = data.contact
        bits, count, self.lowest = _scan(
            contact.geom, contact.frame, contact.pos, contact.dist, contact.efc_address, data.efc_force, data.efc_vel,
            self._classes, self._links, self._table[stage], self._seen, self._fresh,
            data.xmat[self._box], data.xpos[self._box], data.xmat[self._lid], self._half, self._corners,
            self._opening, lid_shut, self.face_load, self.link_load, self.link_slide,
        )  # fmt: skip
        return bits, self._fresh[:count] if count else _NONE


@compiled
def _scan(
    geoms: Indices, frames: Matrix, points: Matrix, depths: Vector, addresses: Indices, force: Vector, velocity: Vector,
    classes: Indices, links: Indices, table: Indices, seen: Indices, fresh: Indices,
    R_box: Vector, p_box: Vector, R_lid: Vector, half: Vector, corners: Matrix, opening: Vector, lid_shut: bool,
    face_load: Vector, link_load: Vector, link_slide: Matrix,
) -> tuple[int, int, float]:  # fmt: skip
    bits = 0
    count = 0
    face_load[:] = 0.0
    link_load[:] = 0.0
    link_slide[:] = 0.0
    for c in range(len(depths)):
        if depths[c] > 0.0 or addresses[c] < 0:
            continue
        first, second = geoms[c, 0], geoms[c, 1]
        of_first, of_second = classes[first], classes[second]
        # `own` is the box's geom, `other` what touches it; +1 if the contact's normal points into the box.
        box_first, box_second = of_first >= _SHELL, of_second >= _SHELL
        normal = frames[c, :3]
        own = of_first if box_first else of_second
        if own == _SHELL and box_first != box_second:
            depth = -(half[0] * abs(opening[0]) + half[1] * abs(opening[1]) + half[2] * abs(opening[2]))
            for k in range(3):
                n_k = R_box[3 * k] * opening[0] + R_box[3 * k + 1] * opening[1] + R_box[3 * k + 2] * opening[2]
                depth += n_k * (points[c, k] - p_box[k])
            if depth > -RIM_M:
                own = _RIM
                if box_first:
                    of_first = _RIM
                else:
                    of_second = _RIM
        verdict = table[of_first, of_second]
        if verdict != 1 and seen[first, second] == 0 and count < len(fresh):
            seen[first, second] = 1
            fresh[count, 0], fresh[count, 1], fresh[count, 2] = first, second, verdict
            count += 1
        if box_first == box_second:
            continue
        other = of_second if box_first else of_first
        link = links[second] if box_first else links[first]
        into = -1.0 if box_first else 1.0
        is_panel = own == _LID or own == _TAB
        if _RIGHT_FIRST <= other <= _RIGHT_LAST:
            bits |= 1
            if is_panel:
                bits |= 16
            if own == _TAB and other == _THUMB:
                bits |= 32
            if own == _LID:
                side = 0.0
                for k in range(3):
                    side -= into * normal[k] * R_lid[3 * k + 2]
                if other == _THUMB and side < -SIDE_COSINE:
                    bits |= 64
                if other > _THUMB and side > SIDE_COSINE:
                    bits |= 128
        elif _LEFT_FIRST <= other <= _LEFT_LAST:
            bits |= 2
        elif other == _TABLE:
            bits |= 4
        else:
            bits |= 8
        if is_panel and not lid_shut:
            continue
        row = addresses[c]
        load = force[row]
        for k in range(3):
            n_k = into * (R_box[k] * normal[0] + R_box[3 + k] * normal[1] + R_box[6 + k] * normal[2])
            face_load[2 * k + (1 if n_k > 0.0 else 0)] += abs(n_k) * load
        if link >= 0 and load > 0.0:
            link_load[link] += load
            for k in range(3):
                slide = 0.0
                for j in range(3):
                    v_j = velocity[row + 1] * frames[c, 3 + j] + velocity[row + 2] * frames[c, 6 + j]
                    slide += R_box[3 * j + k] * v_j
                # MuJoCo's row is the velocity of the second geom against the first: turn it to hand against box.
                link_slide[link, k] -= into * load * slide
    for link in range(len(link_load)):
        if link_load[link] > 0.0:
            link_slide[link] /= link_load[link]
    lowest = np.inf
    for n in range(len(corners)):
        height = p_box[2] + R_box[6] * corners[n, 0] + R_box[7] * corners[n, 1] + R_box[8] * corners[n, 2]
        lowest = min(lowest, height)
    return bits, count, lowest
