"""A left hand that stalls on its way to the held box draws back and comes again, in physics."""

from __future__ import annotations

from typing import Any

import pytest

from preshape.control import task_regrasp
from preshape.control.failure import TaskFailed
from preshape.control.motions import Motion
from preshape.tools.configuration import load_scenario
from preshape.tools.run_options import RunOptions
from preshape.tools.session import run_session

pytestmark = [pytest.mark.physics, pytest.mark.slow]

STALLS_AFTER = 400
"""Ticks of the first insertion, of some two thousand: the fingers are beside the box by then."""


def test_a_left_hand_that_stalls_beside_the_box_comes_again_and_takes_it(monkeypatch: pytest.MonkeyPatch) -> None:
    insert, calls = task_regrasp.insert, list[int]()

    def stalling(*arguments: Any, **options: Any) -> Motion:
        calls.append(0)
        for tick, _ in enumerate(insert(*arguments, **options)):
            if len(calls) == 1 and tick == STALLS_AFTER:
                raise TaskFailed("stalled: by this test")
            yield

    monkeypatch.setattr(task_regrasp, "insert", stalling)
    report = run_session(load_scenario("tea_box"), 8, RunOptions(until_task=3, record=False, pictures=False)).report
    assert report.success, report.failure
    assert len(calls) == 2
    assert any("stalled: by this test; held elsewhere" in note for note in report.notes)
    assert report.referee.undesired_contacts == []
