"""A grasp that misses is tried again, in physics: the object is seen elsewhere until the hand has closed there."""

from __future__ import annotations

import pytest

from preshape.tools.configuration import load_scenario
from preshape.tools.run_options import RunOptions
from preshape.tools.session import run_session

pytestmark = [pytest.mark.physics, pytest.mark.slow]

SEEN_ELSEWHERE = ["perception.startup_bias_m=0.16", "perception.startup_s=15.0"]
"""In seed 32 the bias is level and leaves the hand room beside the object."""


def test_a_hand_that_has_closed_beside_the_object_opens_comes_back_and_lifts_it() -> None:
    scenario = load_scenario("cylinder", SEEN_ELSEWHERE)
    report = run_session(scenario, 32, RunOptions(until_task=1, record=False, pictures=False)).report
    assert report.success, report.failure
    assert report.tasks[0].outcome == "done" and report.tasks[0].attempts == 2
    assert any("attempt 1: missed: the right hand" in note for note in report.notes)
    assert report.referee.undesired_contacts == [] and not report.referee.dropped
