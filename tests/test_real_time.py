"""What threads ask of the machine: nothing where there is one core, and never more than it grants."""

from __future__ import annotations

import os

import pytest

from preshape.sim_backend.physics_core import physics_core
from preshape.tools.real_time import (
    LOOP_PRIORITY,
    PLANNING_NICENESS,
    THINKING_PRIORITY,
    give_up_priority,
    real_time,
    take_priority,
)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """Return what was asked of the scheduler, which is not there in earnest."""
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda thread, policy, parameters: asked.append((thread, policy)))
    monkeypatch.setattr(os, "sched_setaffinity", lambda thread, cores: asked.append((thread, set(cores))))
    monkeypatch.setattr(os, "setpriority", lambda which, thread, niceness: asked.append((thread, niceness)))
    return asked


def test_on_one_core_nobody_goes_first(asked: list[tuple[object, ...]]) -> None:
    take_priority(THINKING_PRIORITY, 7, {0})
    give_up_priority(7, {0})
    assert asked == []


def test_a_thread_that_plans_shares_but_stays_ahead(asked: list[tuple[object, ...]]) -> None:
    take_priority(THINKING_PRIORITY, 7, {0, 1})
    give_up_priority(7, {0, 1})
    assert asked == [(7, os.SCHED_FIFO), (7, {0}), (7, os.SCHED_OTHER), (7, {0, 1}), (7, PLANNING_NICENESS)]
    assert PLANNING_NICENESS < 0


@pytest.mark.parametrize("cores", [{0, 1}, {2, 3, 7}, set(range(16))])
def test_physics_and_loops_do_not_share_a_core(cores: set[int], asked: list[tuple[object, ...]]) -> None:
    core = physics_core(cores)
    take_priority(LOOP_PRIORITY, 0, cores)
    ((_, loop),) = (entry for entry in asked if isinstance(entry[1], set))
    assert core in cores and loop == cores - {core}


def test_what_the_machine_refuses_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    monkeypatch.setattr(os, "setpriority", refuse)
    take_priority(THINKING_PRIORITY, 0, {0, 1})
    give_up_priority(0, {0, 1})


def test_after_real_time_a_thread_is_as_before() -> None:
    before = os.sched_getscheduler(0), os.sched_getaffinity(0)
    with real_time():
        pass
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0)) == before
