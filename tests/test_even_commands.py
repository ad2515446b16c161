"""Broadcasts that arrive unevenly are taken at even distances, the newest of them; none is taken twice."""

from __future__ import annotations

from preshape.sim_backend.even_commands import EvenCommands


def taken(arrivals: dict[int, bytes], steps: int, period: int) -> dict[int, bytes]:
    """Return what is taken in which step when broadcasts arrive in some."""
    commands = EvenCommands()
    found: dict[int, bytes] = {}
    for step in range(steps):
        if step in arrivals:
            commands.put(arrivals[step])
        payload = commands.due(step, period)
        if payload is not None:
            found[step] = bytes(payload)
    return found


def test_late_and_early_broadcasts_are_taken_a_period_apart() -> None:
    arrivals = {0: b"a", 2: b"b", 5: b"c", 6: b"d", 9: b"e", 10: b"f"}
    assert taken(arrivals, 12, 2) == {1: b"a", 3: b"b", 5: b"c", 7: b"d", 9: b"e", 11: b"f"}


def test_of_two_that_wait_the_newer_is_taken_and_once() -> None:
    assert taken({0: b"old", 1: b"new"}, 10, 2) == {1: b"new"}


def test_a_longer_cycle_is_kept_when_it_is_set() -> None:
    assert list(taken({k: b"x" for k in range(0, 60, 20)}, 70, 20)) == [1, 21, 41]
