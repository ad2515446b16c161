"""The box that shows the wrong face is put back, where it can be taken by the other grip."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from preshape.control.failure import TaskFailed
from preshape.control.grasp_choice import PREGRASP_M, back_off, reachable_grips
from preshape.control.motions import Motion, lead_palm, wait
from preshape.control.task_grasp import take_off
from preshape.control.work import Work
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, exp_so3, inverse, raised, transform
from preshape.hal.world import Workcell
from preshape.planner.air_pose import AirPlace
from preshape.planner.plan_scene import LIFT_M

SET_DOWN_M = 0.004
"""Height above the table from which the box is let go, m."""
ASIDE_M = (0.08, 0.16, 0.24)
"""How far from where it was taken the box may be put, the nearest first, m."""
DIRECTIONS = 8
"""In how many directions from there."""
TURNS = (0.0, np.pi, 0.5 * np.pi, -0.5 * np.pi)
"""How far the box may be turned about the vertical, rad: half a turn brings the other grip where this one was."""
EDGE_M = 0.03
"""Distance from the table's edge that is kept by what stands on it, m."""


def put_back(work: Work, place: AirPlace) -> Motion:
    """Stand the held box where it was taken from, let go and draw back.

    With obstacles about, elsewhere on the table if only there another grip reaches it; it will be shown at `place`.
    Palm and box are moved and turned about the vertical as one from where the hand closed: the table is level, which
    the eye tells to a degree or two only.
    """
    if work.stood_at is None or work.taken_at is None:
        raise TaskFailed("unreachable: the box was not taken from anywhere")
    body = work.body
    work.phase = "put back"
    rest = resting_place(work, work.stood_at, work.taken_at, place) if work.sight.obstacles else None
    X_stand = raised(work.taken_at if rest is None else rest.X_world_palm, SET_DOWN_M)
    if rest is None:
        yield from work.carry_to_palm("right", raised(X_stand, LIFT_M))
    else:
        yield from work.travel("right", rest.lifted)
        body.prefer_posture("right", rest.down)
    yield from lead_palm(body, "right", X_stand, speed=0.08)
    yield from wait(body, 0.2)
    work.sight.release()
    yield from take_off(work, "right", PREGRASP_M)


@dataclass(frozen=True, slots=True, eq=False)
class RestingPlace:
    """Where a box may be put: the palm's pose then (world), and the arm's postures (7) above and at it."""

    X_world_palm: Matrix
    lifted: Vector
    down: Vector


def resting_place(work: Work, X_stood: Matrix, X_taken: Matrix, place: AirPlace) -> RestingPlace | None:
    """Return the nearest place on the table to which the hand can bring the box, and from which another grip takes it.

    One with room for both, if there is one: a box that is let go does not stand where it was to, to the millimetre.
    None where there is none: the box goes where it stood.
    """
    with work.wanting_room():
        roomy = _nearest_place(work, X_stood, X_taken, place)
    return roomy or _nearest_place(work, X_stood, X_taken, place)


def _nearest_place(work: Work, X_stood: Matrix, X_taken: Matrix, place: AirPlace) -> RestingPlace | None:
    carried = work.collision()
    for X_move in moves_on_table(X_stood[:3, 3]):
        X_rest, X_palm = X_move @ X_stood, X_move @ X_taken
        if not stands_on_table(work.cell, X_rest, work.box.size):
            continue
        around = work.collision(exempt=(("right_hand", "box"),), standing=X_rest, fingers=work.grips["right"].opened)
        palms = np.array([raised(X_palm, LIFT_M), X_palm, back_off(X_palm, PREGRASP_M)])
        way = work.way("right", palms, (carried, around, around), work.body.asked_arm("right"))
        if way is not None and reachable_grips(work, place, X_rest, way[-1])[0]:
            return RestingPlace(X_palm, way[0], way[1])
    return None


def moves_on_table(center: Matrix) -> Iterator[Matrix]:
    """Yield rigid motions (world) that shift what stands at a point (3,), m, on the table and turn it about itself."""
    shifts = [np.zeros(3)]
    for distance in ASIDE_M:
        angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
        shifts += [distance * np.array([np.cos(angle), np.sin(angle), 0.0]) for angle in angles]
    for shift in shifts:
        for turn in TURNS:
            yield transform(center + shift) @ transform(R=exp_so3(np.array([0.0, 0.0, turn]))) @ transform(-center)


def stands_on_table(cell: Workcell, X_world_box: Matrix, size: Matrix) -> bool:
    """Tell whether a box of a size (3,), m, at a pose would stand within the table's edges."""
    table = next(static for static in cell.statics if static.name == "table")
    X_table_box = inverse(table.X_world_box) @ X_world_box
    reach = np.abs(X_table_box[:2, :3]) @ (np.asarray(size) / 2)
    return bool((np.abs(X_table_box[:2, 3]) + reach + EDGE_M <= table.half[:2]).all())
