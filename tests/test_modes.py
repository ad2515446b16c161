"""Laws of the mode table, walked completely."""

from __future__ import annotations

import itertools

import pytest

from preshape.control.modes import MODE_TABLE, WRITING, LoopEvent, LoopMode, next_mode


@pytest.mark.parametrize(("mode", "event"), list(itertools.product(LoopMode, LoopEvent)))
def test_every_pair_is_either_in_the_table_or_refused_with_the_events_allowed(mode: LoopMode, event: LoopEvent) -> None:
    if (mode, event) in MODE_TABLE:
        assert next_mode(mode, event) is MODE_TABLE[mode, event]
        return
    with pytest.raises(ValueError, match="allowed are") as refused:
        next_mode(mode, event)
    assert event.value in str(refused.value)
    assert all(other.value in str(refused.value) for (at, other) in MODE_TABLE if at is mode)


def _reachable(start: LoopMode, without: set[LoopEvent]) -> set[LoopMode]:
    found, frontier = {start}, [start]
    while frontier:
        mode = frontier.pop()
        for (at, event), after in MODE_TABLE.items():
            if at is mode and event not in without and after not in found:
                found.add(after)
                frontier.append(after)
    return found


@pytest.mark.parametrize("mode", LoopMode)
def test_a_stop_and_a_fault_are_taken_in_every_mode_and_never_lead_to_motion(mode: LoopMode) -> None:
    assert next_mode(mode, LoopEvent.FAULT) is LoopMode.STOPPED
    assert next_mode(mode, LoopEvent.STOP) in {LoopMode.DISARMED, LoopMode.STOPPED, LoopMode.STOPPING}


def test_only_a_running_loop_has_to_brake() -> None:
    braking = {mode for mode in LoopMode if next_mode(mode, LoopEvent.STOP) is LoopMode.STOPPING}
    assert braking == {LoopMode.RUNNING, LoopMode.STOPPING}


@pytest.mark.parametrize("start", [LoopMode.DISARMED, LoopMode.STOPPED])
def test_nothing_is_written_again_without_an_explicit_order_to_arm(start: LoopMode) -> None:
    assert not _reachable(start, {LoopEvent.ARM}) & WRITING


def test_nothing_runs_before_the_device_has_confirmed_that_it_is_armed() -> None:
    assert LoopMode.RUNNING not in _reachable(LoopMode.DISARMED, {LoopEvent.ARMED})
    assert LoopMode.RUNNING in _reachable(LoopMode.DISARMED, set())


def test_every_mode_is_reachable_and_none_is_a_dead_end() -> None:
    assert _reachable(LoopMode.DISARMED, set()) == set(LoopMode)
    for mode in LoopMode:
        assert LoopMode.DISARMED in _reachable(mode, set())
