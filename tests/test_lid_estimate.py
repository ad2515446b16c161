"""Tab and lid are drawn as far open as the thumb has moved them, and nothing closes them again."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.opening_frame import opening_frame
from preshape.hal.layout import LAYOUT
from preshape.hal.sah_hand import TIP_RADIUS
from preshape.hal.tick_record import TickRecord, new_record
from preshape.hal.transform import transform
from preshape.hal.world import FACES, Opening, face_normal
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.plan_scene import ARMS_AT_REST
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import nominal_box
from preshape.tools.lid_estimate import LidEstimate

BOX, BASE = nominal_box(Scenario(name="box")), transform((0.1, -0.3, 0.2))
OPENING = Opening(face="-x", edge="+y", offset=0.004)
FRAME = opening_frame(BOX, OPENING)
HINGE_M, TAB_HINGE_M = BOX.size[1] - BOX.tab_size[1] / 2, BOX.tab_size[1] / 2


def record_with_tip(tip: tuple[float, float, float], task: int, phase: str) -> TickRecord:
    """Return a record in which the thumb's tip is at a point of the opening's frame, m."""
    record = new_record()
    record["task"], record["phase"] = task, phase
    record["position"][:] = 0.0
    record["position"][LAYOUT.arm("right")] = ARMS_AT_REST
    X_palm = palm_pose("right", BASE, record["position"][LAYOUT.arm("right")])
    p_tip = hand_kinematics("right").tips(record["position"][LAYOUT.hand("right")])[0][0]
    at = (FRAME @ [*tip, 1.0])[:3]
    record["X_world_object"] = transform(X_palm[:3, :3] @ p_tip + X_palm[:3, 3] - at)
    record["opening_face"], record["opening_edge"] = FACES.index(OPENING.face), FACES.index(OPENING.edge)
    record["opening_offset"] = OPENING.offset
    return record


def lifted(angle: float) -> tuple[float, float, float]:
    """Return where the tip is under a lid that stands at an angle (rad)."""
    return 0.05 * np.cos(angle) - HINGE_M, 0.01, 0.05 * np.sin(angle) - TIP_RADIUS


@pytest.fixture
def estimate() -> LidEstimate:
    return LidEstimate.of_record(BASE, BOX, record_with_tip((0.0, 0.0, 0.1), 4, "above"))


def test_the_lid_stands_as_high_as_the_thumb_beneath_it_has_been(estimate: LidEstimate) -> None:
    assert estimate.update(record_with_tip(lifted(0.5), 5, "raise"))
    assert estimate.lid == pytest.approx(0.5)
    assert not estimate.update(record_with_tip(lifted(0.3), 5, "raise"))
    assert estimate.update(record_with_tip(lifted(1.6), 5, "turn"))
    assert estimate.lid == pytest.approx(1.6)


@pytest.mark.parametrize(("task", "phase"), [(3, "raise"), (4, "above"), (5, "above"), (5, "leave")])
def test_a_thumb_above_the_lid_does_not_open_it(estimate: LidEstimate, task: int, phase: str) -> None:
    assert not estimate.update(record_with_tip(lifted(1.0), task, phase))
    assert estimate.lid == 0.0


def test_the_tab_is_pushed_in_by_a_thumb_that_comes_down_on_it(estimate: LidEstimate) -> None:
    assert not estimate.update(record_with_tip((0.005, 0.0, 0.05), 4, "touch"))
    assert estimate.update(record_with_tip((0.005, 0.0, -0.02), 4, "crush"))
    assert estimate.tab == pytest.approx(np.arctan2(0.02 + TIP_RADIUS, 0.005 + TAB_HINGE_M))


def test_the_lid_turns_outwards_about_its_hinge_and_the_tab_inwards_about_its_own(estimate: LidEstimate) -> None:
    outward = face_normal(OPENING.face)
    hinge, tab_hinge, rim = (FRAME @ [x, 0.0, 0.0, 1.0] for x in (-HINGE_M, -TAB_HINGE_M, TAB_HINGE_M))
    estimate.update(record_with_tip((0.005, 0.0, -0.02), 4, "crush"))
    np.testing.assert_allclose(estimate.X_box_tab @ tab_hinge, tab_hinge, atol=1e-12)
    assert ((estimate.X_box_tab @ rim)[:3] - rim[:3]) @ outward < -0.01
    estimate.update(record_with_tip(lifted(np.pi / 2), 5, "turn"))
    np.testing.assert_allclose(estimate.X_box_lid @ hinge, hinge, atol=1e-12)
    moved = (estimate.X_box_lid @ rim)[:3] - hinge[:3]
    np.testing.assert_allclose(moved, outward * (HINGE_M + TAB_HINGE_M), atol=1e-9)


def test_what_is_not_known_moves_nothing(estimate: LidEstimate) -> None:
    unseen = record_with_tip(lifted(1.0), 5, "turn")
    unseen["X_world_object"][:] = np.nan
    assert not estimate.update(unseen)
    unmeasured = record_with_tip(lifted(1.0), 5, "turn")
    unmeasured["position"][:] = np.nan
    assert not estimate.update(unmeasured)
