"""Laws of a run's plan: what was carried out is what is reported and drawn."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.grips import brace_grip, cage_grip
from preshape.hal.world import Face, NominalBox, Opening, opposite
from preshape.tools.run_plan import plan_drawing, plan_report, plan_run

BOX = NominalBox(np.array([0.06, 0.09, 0.20]), ("+x", "-x"))
ENDS: tuple[Face, ...] = ("+z", "-z")
FINGERS: tuple[Face, ...] = ("+y", "-y")


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("fingers", FINGERS)
def test_a_grip_that_was_carried_out_counts_as_chosen(end: Face, fingers: Face) -> None:
    right = cage_grip(BOX.size, end, fingers, "right")
    left = brace_grip(BOX.size, opposite(end), "+x", "left")
    plan = plan_run(BOX, Opening("+x", "+y", 0.01), {"right": right, "left": left})
    report = plan_report(plan)
    assert report.grips["right"].palm == end and report.grips["right"].fingers == fingers
    assert report.grips["left"].palm == opposite(end)
    taken = report.chosen["right hand, tasks 1-3"], report.chosen["left hand, tasks 3-5"]
    assert f"palm {end}, grasp +y -y" in taken[0]
    assert f"palm {opposite(end)}, grasp +y -y" in taken[1]
    drawn = plan_drawing(plan)
    assert [grasp.side for grasp in drawn.grasps] == ["right", "left"]
    assert drawn.grasps[0].box.palm_face == end
    assert drawn.grasps[0].box.finger_face == fingers
    # The thumb waits on its own side of the box, the middle finger on the other.
    axis = "xyz".index(fingers[1])
    thumb, middle = drawn.grasps[0].tips[0, axis], drawn.grasps[0].tips[2, axis]
    assert np.sign(middle) == (1.0 if fingers[0] == "+" else -1.0) == -np.sign(thumb)


def test_before_any_grip_priorities_and_what_is_left_are_reported_and_only_the_search_is_drawn() -> None:
    plan = plan_run(BOX, None, {})
    report = plan_report(plan)
    assert report.priorities["r"] == [2, 2, 2, 1, 1]
    assert report.grips == {} and len(report.components["right hand, tasks 1-3"]) > 0
    drawn = plan_drawing(plan)
    assert drawn.grasps == () and len(drawn.searched) > 0
