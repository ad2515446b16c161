"""Objects that are no boxes are grasped by a planned grip and lifted, in physics."""

from __future__ import annotations

import pytest

from preshape.tools.configuration import load_scenario
from preshape.tools.report import decode_report, encode_report
from preshape.tools.run_options import RunOptions
from preshape.tools.session import run_session

pytestmark = pytest.mark.physics


@pytest.mark.parametrize(("name", "part"), [("l_carton", "upright"), ("cylinder", "cylinder")])
def test_an_object_of_convex_parts_is_lifted_by_the_planners_grip(name: str, part: str) -> None:
    result = run_session(load_scenario(name), 2, RunOptions(record=False))
    report = result.report
    assert report.success and report.failure is None and result.exit_code == 0
    assert [(task.task, task.name, task.outcome) for task in report.tasks] == [
        (1, "grasp", "done"),
        (2, "hold", "done"),
    ]
    assert all(task.done for task in report.referee.tasks) and report.referee.undesired_contacts == []
    assert report.referee.hold_slip_mm < 5.0 and not report.referee.dropped and not report.referee.crushed
    assert report.plan.priorities == {"r": [1, 1], "l": [None, None], "c": [None, None]}
    assert report.plan.grips["right"].name == f"planned, {part}"
    (chosen,) = report.plan.chosen.values()
    assert chosen in report.plan.components["right hand, tasks 1-2"]
    assert report.controller_failure is None and decode_report(encode_report(report)) == report
    drawing = result.evidence.plan if result.evidence is not None else None
    assert drawing is not None and len(drawing.grasps) == 1 and len(drawing.parts) == (2 if name == "l_carton" else 1)


def test_what_no_arm_reaches_is_named_before_anything_moves() -> None:
    scenario = load_scenario("cylinder", ["box.position_m=[0.9, 0.5]", "draw.position_m=0.0"])
    report = run_session(scenario, 0, RunOptions(record=False, pictures=False)).report
    assert not report.success and report.failed_task == 1
    assert report.cause is not None and report.cause.startswith("unreachable")
    assert report.plan.priorities["r"] == [1, 1] and report.plan.grips == {}
