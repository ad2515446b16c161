"""Who may touch whom in which task: geoms sorted into classes, and the table of allowed pairs as data."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from preshape.hal import sah_hand
from preshape.hal.layout import SIDES, Side

HAND_CLASSES = ("palm", *sah_hand.FINGERS)
CLASSES: tuple[str, ...] = (
    "table",
    "column",
    "obstacle",
    *(f"{side}_arm" for side in SIDES),
    *(f"{side}_{part}" for side in SIDES for part in HAND_CLASSES),
    "shell",
    "rim",
    "lid",
    "tab",
    "unseen",
)
"""What a geom can be. `rim`: points of the shell near the opening face's plane; decided per contact, not per geom."""
CLASS = {name: number for number, name in enumerate(CLASSES)}

STAGES = 6
"""Stage k = 1 .. 5: task k's true end has not come yet; 6: all have."""
UNDESIRED, ALLOWED, SELF = 0, 1, 2
"""Entries of the table; SELF marks two parts of one hand, which are reported apart."""

BOX = ("shell", "rim", "lid", "tab")
PARTS = tuple(sah_hand.PARTS)


def hand(side: Side) -> tuple[str, ...]:
    """Return the classes of one hand."""
    return tuple(f"{side}_{part}" for part in HAND_CLASSES)


Rules = Mapping[int, tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]]
"""Stage -> pairs of class groups that may touch; every pair not listed must not."""

_LID_PINCH = ("rim", "lid", "tab")
RULES: Rules = {
    1: ((("table",), BOX), (hand("right"), BOX)),
    2: ((("table",), BOX), (hand("right"), BOX)),
    3: ((hand("right"), BOX), (hand("left"), BOX)),
    4: ((("right_thumb",), BOX), (hand("left"), BOX)),
    5: ((("right_thumb",), BOX), (("right_fore", "right_middle"), _LID_PINCH), (hand("left"), BOX)),
    6: ((("right_thumb",), BOX), (("right_fore", "right_middle"), _LID_PINCH), (hand("left"), BOX)),
}
"""The opening. In stage 2 the right hand may set the box down again to take it the other way round."""

LIFT_RULES: Rules = {
    1: ((("table",), BOX), (hand("right"), BOX)),
    2: ((hand("right"), BOX),),
    3: ((hand("right"), BOX),),
}
"""The lift of an object that has no lid, all of which counts as shell: once lifted it stays off the table."""


def contact_table(all_rules: Rules = RULES) -> NDArray[np.int8]:
    """Return the table (stage, class, class), symmetric: UNDESIRED, ALLOWED or SELF; stage 0 is not used."""
    table = np.full((STAGES + 1, len(CLASSES), len(CLASSES)), UNDESIRED, dtype=np.int8)
    for stage, rules in all_rules.items():
        for first, second in rules:
            for a, b in product(first, second):
                table[stage, CLASS[a], CLASS[b]] = table[stage, CLASS[b], CLASS[a]] = ALLOWED
    for side in SIDES:
        own = [CLASS[name] for name in hand(side)]
        table[np.ix_(range(STAGES + 1), own, own)] = SELF
    return table


def geom_classes(model: mujoco.MjModel) -> NDArray[np.int64]:
    """Return the class of every geom of a scene; `ValueError` names one that has none."""
    return np.array([CLASS[_class_of(model, geom)] for geom in range(model.ngeom)], dtype=np.int64)


def hand_links(model: mujoco.MjModel) -> NDArray[np.int64]:
    """Return for every geom its link's number, right hand 0 .. 17, left hand 18 .. 35, in part order; else -1."""
    names = [f"{side}_{part}" for side in SIDES for part in PARTS]
    found = [model.geom(geom).name for geom in range(model.ngeom)]
    return np.array([names.index(name) if name in names else -1 for name in found], dtype=np.int64)


def _class_of(model: mujoco.MjModel, geom: int) -> str:
    name, body = model.geom(geom).name, model.body(int(model.geom_bodyid[geom])).name
    if model.geom_contype[geom] == 0 and model.geom_conaffinity[geom] == 0:
        return "unseen"
    if body in ("box", "lid", "tab"):
        return "shell" if body == "box" else body
    if name in ("table", "column"):
        return name
    if body.startswith("obstacle_"):
        return "obstacle"
    for side in SIDES:
        if name.startswith(f"{side}_arm_"):
            return f"{side}_arm"
        for part in HAND_CLASSES:
            if name.startswith(f"{side}_{part}"):
                return f"{side}_{part}"
    raise ValueError(f"geom {name!r} of body {body!r}: belongs to none of {', '.join(CLASSES)}")
