"""Laws of the sets of hold states: hands are alike, and what a regrasp reaches has a state before it."""

import numpy as np
import pytest

from preshape.planner.hand_cover import Covers, hand_covers
from preshape.planner.hold_states import NO_STATES, OFF, Onto, States, before_regrasp, possible, regrasped
from preshape.planner.sections import split
from preshape.tools.random_procedure import random_box

BITS = OFF + 1


def mirrored(states: States) -> States:
    """Return the set with both hands exchanged."""
    return tuple(sum(1 << k for k in range(BITS) if states[k] >> row & 1) for row in range(BITS))


def drawn(rng: np.random.Generator, share: float) -> int:
    return sum(1 << k for k in range(OFF) if rng.random() < share)


def cases(count: int) -> list[tuple[States, Covers, Onto]]:
    """Return sets of possible states, with a regrasp after them: half with a helper, who is off the box before."""
    rng = np.random.default_rng(8)
    found: list[tuple[States, Covers, Onto]] = []
    for _ in range(count):
        covers = hand_covers(split(*random_box(rng)))
        share, helper, right = float(rng.choice([0.2, 0.6])), bool(rng.random() < 0.5), bool(rng.random() < 0.5)
        own, other = drawn(rng, 0.7), drawn(rng, 0.7) | (0 if helper else int(rng.integers(2)) << OFF)
        held, beside = drawn(rng, 0.8), 1 << OFF if helper else drawn(rng, 0.8) | 1 << OFF
        states = possible(covers, *((held, beside) if right else (beside, held)))
        kept = tuple(row & sum(1 << k for k in range(BITS) if rng.random() < share) for row in states)
        found.append((kept, covers, Onto(right, own, other, helper)))
    return found


def test_what_one_hand_can_do_the_other_can() -> None:
    changed = 0
    for states, covers, onto in cases(300):
        exchanged = Onto(not onto.right, onto.own, onto.other, onto.helper)
        after = regrasped(states, covers, onto)
        assert regrasped(mirrored(states), covers, exchanged) == mirrored(after)
        changed += after != NO_STATES
    assert changed > 100


@pytest.mark.parametrize("helper", [False, True])
def test_a_state_is_reached_by_a_regrasp_if_and_only_if_a_state_lies_before_it(helper: bool) -> None:
    reached = 0
    for states, covers, onto in [case for case in cases(60) if case[2].helper == helper]:
        after = regrasped(states, covers, onto)
        # A helper has left the box again.
        others = (OFF,) if helper else range(BITS)
        for own in range(OFF):
            for other in others:
                state = (own, other) if onto.right else (other, own)
                before = before_regrasp(states, covers, onto, state)
                assert (before is not None) == bool(after[state[0]] >> state[1] & 1)
                assert before is None or states[before[0]] >> before[1] & 1
                reached += before is not None
    assert reached > 100
