"""What threads ask of the machine: nothing where there is one core, and never more than it grants."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Set
from dataclasses import dataclass

import pytest

from preshape.sim_backend.paced_layout import PHYSICS
from preshape.tools import real_time
from preshape.tools.real_time import (
    PLANNING_NICENESS,
    THINKING_PRIORITY,
    cores_apart,
    give_up_priority,
    take_priority,
)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """Return what was asked of the scheduler, which is not there in earnest."""
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda thread, policy, parameters: asked.append((thread, policy)))
    monkeypatch.setattr(os, "setpriority", lambda which, thread, niceness: asked.append((thread, niceness)))
    return asked


def test_on_one_core_nobody_goes_first(monkeypatch: pytest.MonkeyPatch, asked: list[tuple[object, ...]]) -> None:
    monkeypatch.setattr(real_time, "CORES", frozenset({0}))
    take_priority(THINKING_PRIORITY, 7)
    give_up_priority(7)
    assert asked == []


def test_a_thread_that_plans_shares_but_stays_ahead(
    monkeypatch: pytest.MonkeyPatch, asked: list[tuple[object, ...]]
) -> None:
    monkeypatch.setattr(real_time, "CORES", frozenset({0, 1}))
    take_priority(THINKING_PRIORITY, 7)
    give_up_priority(7)
    assert asked == [(7, os.SCHED_FIFO), (7, os.SCHED_OTHER), (7, PLANNING_NICENESS)]
    assert PLANNING_NICENESS < 0


def test_what_the_machine_refuses_is_done_without(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError

    monkeypatch.setattr(real_time, "CORES", frozenset({0, 1}))
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", refuse)
    take_priority(THINKING_PRIORITY)
    give_up_priority(0)


@dataclass
class _Child:
    name: str
    pid: int


@pytest.mark.parametrize("cores", [{0, 1}, {2, 3, 7}, set(range(16))])
def test_physics_and_the_loop_that_drives_it_do_not_share_a_core(
    cores: Set[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    bound: list[tuple[int, Set[int]]] = []
    monkeypatch.setattr(real_time, "CORES", frozenset(cores))
    monkeypatch.setattr(os, "sched_setaffinity", lambda thread, on: bound.append((thread, set(on))))
    monkeypatch.setattr(multiprocessing, "active_children", lambda: [_Child("camera", 6), _Child(PHYSICS, 7)])
    with cores_apart():
        (physics, has), (own, keeps) = bound
        assert (physics, own) == (7, 0)
        assert len(has) == 1 and keeps and has | keeps == cores and not has & keeps
    assert bound[2:] == [(0, cores)]


def test_without_physics_of_its_own_a_loop_is_not_bound() -> None:
    before = os.sched_getaffinity(0)
    with cores_apart():
        assert os.sched_getaffinity(0) == before
    assert os.sched_getaffinity(0) == before
