"""Laws of putting a box back: on the table, upright, and where the other grip reaches it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from preshape.control.body import Body
from preshape.control.carrier import CarryOptions
from preshape.control.grasp_choice import GraspChoice, reachable_grips, shown_face
from preshape.control.guard import ObstacleGuard
from preshape.control.sight import Sight
from preshape.control.task_put_back import EDGE_M, moves_on_table, resting_place, stands_on_table
from preshape.control.work import Work
from preshape.hal.layout import LAYOUT
from preshape.hal.transform import Matrix, exp_so3, inverse, raised, transform
from preshape.hal.world import NominalBox, OrientedBox
from preshape.planner.air_pose import AirPlace
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.plan_scene import LIFT_M
from preshape.planner.work_object import box_object
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell
from preshape.sim_backend.simulation import home_position

CELL = workcell(Scenario(name="cell"))
BOX = NominalBox(np.array([0.06, 0.09, 0.20]), ("+x", "-x"))
TABLE = next(static for static in CELL.statics if static.name == "table")


def standing(x: float, y: float, yaw: float = 0.0) -> Matrix:
    return transform((x, y, BOX.size[2] / 2), exp_so3(np.array([0.0, 0.0, yaw])))


def test_moves_keep_height_and_uprightness_and_the_first_is_none() -> None:
    X_stood = standing(0.58, -0.18, 0.4)
    moves = list(moves_on_table(X_stood[:3, 3]))
    np.testing.assert_allclose(moves[0], np.eye(4), atol=1e-15)
    gone = [float(np.linalg.norm((X @ X_stood)[:3, 3] - X_stood[:3, 3])) for X in moves]
    assert gone == sorted(gone) or np.allclose(gone, sorted(gone), atol=1e-12), "the nearest come first"
    for X in moves:
        moved = X @ X_stood
        assert moved[2, 3] == pytest.approx(X_stood[2, 3])
        np.testing.assert_allclose(moved[:3, 2], X_stood[:3, 2], atol=1e-12)


@given(x=st.floats(-0.3, 1.3), y=st.floats(-1.2, 1.2), yaw=st.floats(-np.pi, np.pi))
def test_a_box_stands_on_the_table_just_when_all_its_corners_are_inside_the_edges(
    x: float, y: float, yaw: float
) -> None:
    X = standing(x, y, yaw)
    corners = [
        X @ np.array([*(np.array(sign) * BOX.size / 2), 1.0])
        for sign in ((1, 1, -1), (1, -1, -1), (-1, 1, -1), (-1, -1, -1))
    ]
    inside = [np.abs((inverse(TABLE.X_world_box) @ corner)[:2]) + EDGE_M <= TABLE.half[:2] for corner in corners]
    assert stands_on_table(CELL, X, BOX.size) == bool(np.all(inside))


def taken(yaw: float, obstacle_at: tuple[float, float, float]) -> tuple[Work, Matrix, GraspChoice]:
    """Return the ground of a box that the right hand has lifted by its only grip, the box's pose before, the grip."""
    X_stood = standing(0.596, -0.176, yaw)
    post = OrientedBox("obstacle_post", transform(obstacle_at), np.full(3, 0.02))
    body = Body(CELL, 0.002)
    body.follow(home_position(), np.zeros(LAYOUT.dof))
    sight = SimpleNamespace(obstacles=(post,), held_by=None, estimate=None, X_world_box=X_stood)
    guard = ObstacleGuard(body, cast(Sight, sight), BOX)
    work = Work(CELL, BOX, box_object(BOX), body, cast(Sight, sight), {}, guard, CarryOptions())
    (choice,), causes = reachable_grips(work, AirPlace(), X_stood, body.asked_arm("right"))
    assert len(causes) == 1, "the obstacle leaves one grip of two"
    body.ask_arm("right", choice.lift)
    position = home_position()
    position[LAYOUT.arm("right")] = choice.lift
    body.links.update(position)
    sight.held_by, sight.X_world_box, work.grips["right"] = "right", raised(X_stood, choice.lift_m), choice.grip
    work.blank.add(shown_face(choice.grip))
    return work, X_stood, choice


def test_a_box_whose_other_grip_is_blocked_is_put_where_it_is_not() -> None:
    work, X_stood, choice = taken(-0.79, (0.53, -0.268, 0.417))
    X_taken = X_stood @ choice.grip.X_box_palm
    assert not reachable_grips(work, AirPlace(), X_stood, choice.grasp)[0]
    rest = resting_place(work, X_stood, X_taken, AirPlace())
    assert rest is not None
    X_rest = rest.X_world_palm @ inverse(X_taken) @ X_stood
    assert stands_on_table(CELL, X_rest, BOX.size) and X_rest[2, 3] == pytest.approx(X_stood[2, 3])
    (other,), _ = reachable_grips(work, AirPlace(), X_rest, rest.down)
    assert other.finger_face != choice.finger_face
    base = CELL.X_world_base["right"]
    np.testing.assert_allclose(palm_pose("right", base, rest.down), rest.X_world_palm, atol=1e-6)
    np.testing.assert_allclose(palm_pose("right", base, rest.lifted), raised(rest.X_world_palm, LIFT_M), atol=1e-6)


def test_where_no_place_suits_there_is_none() -> None:
    work, X_stood, choice = taken(-0.79, (0.53, -0.268, 0.417))
    work.blank.update(("+x", "-x"))
    assert resting_place(work, X_stood, X_stood @ choice.grip.X_box_palm, AirPlace()) is None
