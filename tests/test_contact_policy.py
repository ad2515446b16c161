"""The whole table of contact rules, cell by cell, against the paper's sentences."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from preshape.control.contact_policy import (
    Contact,
    Phase,
    Settling,
    allowed_parts,
    apply_policy,
    is_left_out,
    members_that,
    rule,
)
from preshape.control.field import Field
from preshape.control.groups import GROUPS, MEMBERS, PART_GROUPS, PART_MEMBERS, group_of, group_parts
from preshape.control.link_boxes import LinkBoxes
from preshape.control.obstacles import Kind, Obstacles
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.transform import transform
from preshape.hal.world import OrientedBox

CELLS = list(product(Phase, Kind, MEMBERS))
THING = (Kind.OBJECT, Kind.OPENING)
ELSE = (Kind.ROBOT, Kind.ENVIRONMENT)
FINGERS = ("fore", "middle", "ring")
TWO = frozenset({"palm", "thumb", "fore"})


def moves(phase: Phase, kind: Kind, member: str) -> tuple[bool, bool]:
    """What the paper lets this pair's repulsion move: (base, the member's own joints)."""
    palm, thumb, finger = member == "palm", member == "thumb", member in FINGERS
    if phase is Phase.APPROACH:
        return True, False
    if phase is Phase.PRESHAPE:
        return True, not palm
    if phase is Phase.NEAR:
        return kind in ELSE, not palm
    if phase is Phase.GRASP:
        return kind is not Kind.OBJECT, False
    if phase is Phase.BEFORE_CONTACT:
        if thumb:
            return kind in ELSE, kind in ELSE
        return True, finger
    if phase is Phase.AFTER_CONTACT:
        return False, finger
    return False, member == "ring"


def contact(phase: Phase, kind: Kind, member: str) -> Contact:
    thumb = member == "thumb"
    if phase is Phase.GRASP and kind is Kind.OBJECT:
        return Contact.MAY if member == "palm" else Contact.MUST
    if phase in (Phase.BEFORE_CONTACT, Phase.AFTER_CONTACT, Phase.PINCH) and thumb and kind in THING:
        return Contact.MUST if kind is Kind.OPENING else Contact.MAY
    if phase is Phase.PINCH and member in ("fore", "middle") and kind is Kind.OPENING:
        return Contact.MUST
    return Contact.AVOID


@pytest.mark.parametrize(("phase", "kind", "member"), CELLS)
def test_every_cell_says_what_the_paper_says(phase, kind, member) -> None:
    cell = rule(phase, kind, member)
    assert cell.contact is contact(phase, kind, member)
    if cell.contact is not Contact.AVOID:
        assert (cell.base, cell.joints) == (0.0, 0.0)
    else:
        assert (cell.base > 0.0, cell.joints > 0.0) == moves(phase, kind, member)
    assert {cell.base, cell.joints} <= {0.0, 1.0}


@pytest.mark.parametrize(("phase", "kind", "member"), CELLS)
def test_a_finger_not_in_use_never_may_touch(phase, kind, member) -> None:
    cell = rule(phase, kind, member, TWO)
    if member in ("middle", "ring"):
        assert cell.contact is Contact.AVOID
        if rule(phase, kind, member).contact is not Contact.AVOID:
            assert cell.joints > 0.0
    else:
        assert cell == rule(phase, kind, member)


@pytest.mark.parametrize(("phase", "kind", "member"), CELLS)
@pytest.mark.parametrize("used", [frozenset(MEMBERS), TWO])
def test_left_out_are_exactly_those_that_may_touch_or_would_mask_another(phase, kind, member, used) -> None:
    cell = rule(phase, kind, member, used)
    acts = cell.base > 0.0 or cell.joints > 0.0
    if acts:
        assert not is_left_out(phase, kind, member, used)
    elif cell.contact is not Contact.AVOID:
        assert is_left_out(phase, kind, member, used)
    else:
        companions = [rule(phase, kind, m, used) for m in MEMBERS if group_of(m) == group_of(member)]
        assert is_left_out(phase, kind, member, used) == any(c.base > 0 or c.joints > 0 for c in companions)


def test_nothing_else_than_the_object_may_ever_be_touched() -> None:
    for phase, kind in product(Phase, ELSE):
        assert not any(allowed_parts(phase, kind))


def test_a_pinch_needs_thumb_fore_and_middle_on_the_opening() -> None:
    everyone = frozenset(MEMBERS)
    assert members_that(Contact.MUST, Phase.PINCH, Kind.OPENING, everyone) == {"thumb", "fore", "middle"}
    assert members_that(Contact.MUST, Phase.BEFORE_CONTACT, Kind.OPENING, everyone) == {"thumb"}
    assert members_that(Contact.MUST, Phase.GRASP, Kind.OBJECT, TWO) == {"thumb", "fore"}


def test_groups_are_the_papers() -> None:
    assert [len(group_parts(group)) for group in GROUPS] == [1, 5, 12]
    assert len(PART_GROUPS) == len(PART_MEMBERS) == 18
    assert [GROUPS[g] for g in PART_GROUPS] == [group_of(member) for member in PART_MEMBERS]


def boxed_field() -> Field:
    """The right hand with one small box 8 mm from the tips' fore side and another beside the palm."""
    links = LinkBoxes()
    q = np.zeros(LAYOUT.dof)
    q[LAYOUT.arm("right")] = [-1.372, -0.859, 1.185, -2.359, 0.814, 1.836, -0.890]
    links.update(q)
    obstacles = Obstacles(links)
    X = links.palm("right")
    around = [transform((0.045, y, z)) for y, z in ((0.0, 0.06), (0.04, 0.2), (-0.04, 0.2), (0.12, 0.12))]
    for kind in (Kind.OBJECT, Kind.OPENING, Kind.ENVIRONMENT):
        boxes = [OrientedBox("part", X @ place, np.full(3, 0.015)) for place in around]
        obstacles.add(kind.value, kind, boxes)
    return Field(links, obstacles)


@pytest.mark.parametrize(("phase", "kind"), list(product(Phase, (Kind.OBJECT, Kind.OPENING, Kind.ENVIRONMENT))))
def test_the_field_moves_exactly_what_the_table_lets_it_move(phase, kind) -> None:
    field = boxed_field()
    apply_policy(field.gains, field.obstacles, "right", phase)
    body = field.obstacles.index(kind.value)
    keep = field.gains.reach[:, :, body].copy()
    field.gains.reach[:] = 0.0
    field.gains.reach[:, :, body] = keep
    results = field.evaluate()
    wrench, torque = results.wrench[0], results.torque[0]
    assert bool(wrench.any()) == any(rule(phase, kind, member).base > 0 for member in MEMBERS)
    assert bool(torque[:4].any()) == (rule(phase, kind, "thumb").joints > 0)
    for number, finger in enumerate(FINGERS):
        if rule(phase, kind, finger).joints == 0.0:
            assert not torque[4 + 3 * number : 7 + 3 * number].any()
    assert bool(torque[4:].any()) == any(rule(phase, kind, finger).joints > 0 for finger in FINGERS)


def test_settling_fades_the_base_out_between_preshape_and_near() -> None:
    field = boxed_field()
    body = field.obstacles.index("object")
    for settled in (0.0, 0.25, 1.0):
        apply_policy(field.gains, field.obstacles, "left", Phase.PRESHAPE, settled=settled)
        hand = SIDES.index("left")
        np.testing.assert_allclose(field.gains.base[hand, :, body], 1.0 - settled)
        np.testing.assert_allclose(field.gains.joints[hand, 1:, body], 1.0)
    with pytest.raises(ValueError, match="settled"):
        apply_policy(field.gains, field.obstacles, "left", Phase.GRASP, settled=0.5)
    with pytest.raises(ValueError, match="settled"):
        apply_policy(field.gains, field.obstacles, "left", Phase.PRESHAPE, settled=1.5)


def test_settling_has_hysteresis() -> None:
    settling = Settling(0.005, 0.015)
    assert [settling.update(e) for e in (0.02, 0.010, 0.005)] == [0.0, pytest.approx(0.5), 1.0]
    assert settling.update(0.0149) == 1.0
    assert settling.update(0.016) == 0.0
    assert settling.update(0.010) == pytest.approx(0.5)
    with pytest.raises(ValueError, match="inner"):
        Settling(0.02, 0.01)


def test_a_body_is_named_once_and_found_or_refused_by_name() -> None:
    field = boxed_field()
    with pytest.raises(ValueError, match="object"):
        field.obstacles.add("object", Kind.OBJECT, [])
    with pytest.raises(KeyError, match="right_hand"):
        field.obstacles.index("nothing")


def test_hidden_bodies_are_not_avoided_and_moved_ones_follow() -> None:
    field = boxed_field()
    for name in ("opening", "environment"):
        field.obstacles.hide("right", name)
    body = field.obstacles.index("object")
    assert np.isfinite(field.evaluate().distance[0, 0, body])
    assert np.all(np.isinf(field.results.distance[0, :, field.obstacles.index("opening")]))
    field.obstacles.move("object", transform((1.0, 0.0, 0.0)))
    assert np.all(np.isinf(field.evaluate().distance[0, :, body]))
    field.obstacles.move("object", np.eye(4))
    field.obstacles.hide("right", "object")
    assert np.all(np.isinf(field.evaluate().distance[0, :, body]))
