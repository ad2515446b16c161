"""What threads ask of the machine: nothing where there is one core, and never more than it grants."""

from __future__ import annotations

import os

import pytest

from preshape.tools.real_time import PLANNING_NICENESS, THINKING_PRIORITY, give_up_priority, take_priority


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """Return what was asked of the scheduler, which is not there in earnest."""
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda thread, policy, parameters: asked.append((thread, policy)))
    monkeypatch.setattr(os, "setpriority", lambda which, thread, niceness: asked.append((thread, niceness)))
    return asked


def test_on_one_core_nobody_goes_first(monkeypatch: pytest.MonkeyPatch, asked: list[tuple[object, ...]]) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0})
    take_priority(THINKING_PRIORITY, 7)
    give_up_priority(7)
    assert asked == []


def test_a_thread_that_plans_shares_but_stays_ahead(
    monkeypatch: pytest.MonkeyPatch, asked: list[tuple[object, ...]]
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1})
    take_priority(THINKING_PRIORITY, 7)
    give_up_priority(7)
    assert asked == [(7, os.SCHED_FIFO), (7, os.SCHED_OTHER), (7, PLANNING_NICENESS)]
    assert PLANNING_NICENESS < 0


def test_what_the_machine_refuses_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1})
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", refuse)
    take_priority(THINKING_PRIORITY)
    give_up_priority(0)
