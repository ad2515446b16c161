"""Laws of reaching for the box: aimed anew when it turns out elsewhere or something is in the way, given up by name."""

from __future__ import annotations

from collections.abc import Generator
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from preshape.control import task_grasp
from preshape.control.approach import FieldGuide
from preshape.control.body import Body
from preshape.control.failure import TaskFailed
from preshape.control.grasp_choice import GraspChoice, back_off
from preshape.control.motions import Motion
from preshape.control.task_grasp import BACK_M, REACHES, reach_box, surround
from preshape.control.work import Work
from preshape.hal.layout import LAYOUT
from preshape.planner.air_pose import AirPlace
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell
from preshape.sim_backend.simulation import home_position

GUIDE = cast(FieldGuide, None)


def ground() -> Work:
    body = Body(workcell(Scenario(name="cell")), 0.002)
    body.follow(home_position(), np.zeros(LAYOUT.dof))
    body.links.update(home_position())
    sight = SimpleNamespace(jumps=0, obstacles=())
    return cast(Work, SimpleNamespace(body=body, sight=sight, phase="", notes=[]))


class Reaching:
    """Stands in for aiming and reaching: each try ends as `outcomes` says, None for well."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, outcomes: list[TaskFailed | None]) -> None:
        self.work, self.outcomes = ground(), outcomes
        self.tried: list[list[str]] = []
        monkeypatch.setattr(task_grasp, "aim", self.aim)
        monkeypatch.setattr(task_grasp, "surround", self.surround)

    def aim(self, work: Work, likely: object, place: object, tried: list[str]) -> Generator[None, None, GraspChoice]:
        self.tried.append(list(tried))
        yield
        return cast(GraspChoice, SimpleNamespace(finger_face="+y" if not tried else "-y"))

    def surround(self, work: Work, guide: object, choice: object) -> Motion:
        work.phase = "insert"
        yield
        failed = self.outcomes.pop(0)
        if failed is not None:
            raise failed

    def run(self) -> GraspChoice:
        reach = reach_box(self.work, GUIDE, None, AirPlace())
        while True:
            try:
                next(reach)
            except StopIteration as end:
                return end.value


def test_a_box_that_is_seen_elsewhere_on_the_way_ends_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    work = ground()

    def near(work: Work, guide: object, choice: object) -> Motion:
        for _ in range(100):
            yield

    monkeypatch.setattr(task_grasp, "come_near", near)
    motion = surround(work, GUIDE, cast(GraspChoice, None))
    for _ in range(10):
        next(motion)
    cast(SimpleNamespace, work.sight).jumps = 1
    with pytest.raises(TaskFailed, match="moved: "):
        next(motion)


def test_a_box_that_turned_out_elsewhere_is_aimed_at_anew_with_every_grip(monkeypatch: pytest.MonkeyPatch) -> None:
    reaching = Reaching(monkeypatch, [TaskFailed("moved: elsewhere"), None])
    assert reaching.run().finger_face == "+y"
    assert reaching.tried == [[], []]


def test_a_stalled_hand_draws_back_along_its_axis_and_tries_another_grip_first(monkeypatch: pytest.MonkeyPatch) -> None:
    reaching = Reaching(monkeypatch, [TaskFailed("stalled: 12 mm from obstacle_post"), None])
    X = reaching.work.body.palm("right")
    assert reaching.run().finger_face == "-y"
    assert reaching.tried == [[], ["+y"]]
    np.testing.assert_allclose(reaching.work.body.asked_palm("right"), back_off(X, BACK_M), atol=1e-9)
    assert any("obstacle_post" in note for note in reaching.work.notes)


def test_the_last_failure_is_the_one_reported_and_others_end_it_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    stalls: list[TaskFailed | None] = [TaskFailed(f"stalled: {k}") for k in range(REACHES)]
    with pytest.raises(TaskFailed, match=f"stalled: {REACHES - 1}"):
        Reaching(monkeypatch, stalls).run()
    reaching = Reaching(monkeypatch, [TaskFailed("missed: nothing there"), None])
    with pytest.raises(TaskFailed, match="missed"):
        reaching.run()
    assert len(reaching.tried) == 1
