"""Before task 1: a lying box is taken across its sides from above, turned, and stood on an end cap."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from preshape.control.failure import TaskFailed
from preshape.control.grip import Grip
from preshape.control.motions import Motion, lead_fingers, lead_palm, wait, wait_for
from preshape.control.straddle_grip import straddle_grip
from preshape.control.work import Work
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, cross, inverse, raised, transform
from preshape.hal.world import FACES, Face, NominalBox, end_caps, face_normal, long_faces
from preshape.planner.air_pose import upper_face
from preshape.planner.arm_capsules import HeldBox
from preshape.planner.arm_reach import score
from preshape.planner.plan_scene import LIFT_M

LYING = 0.7
"""A box whose long axis has a smaller vertical share than this lies."""
ABOVE_M = 0.11
"""Height of the open hand above its grasp pose from which it comes straight down, m."""
OVER_M = 0.07
"""Height above its standing place at which the turned box arrives, m."""
SET_DOWN_M = 0.004
"""Height above the table from which the box is let go, m."""
AWAY_M = 0.11
"""How far the opened hand draws back from the standing box, m."""
LONGEST_STEP_RAD = 0.7
"""Largest joint change from over the place to it, and from there to the drawn-back hand, rad."""
GOOD_SCORE = 20.0
"""Score of an arm posture (`arm_reach.score`) that is as good as any."""
GOOD_RANK = 0.25
"""Rank of a way of standing the box (score over `GOOD_SCORE`, less half the travel in rad) that ends the search."""
PLACES = ((0.52, -0.28), (0.50, -0.20), (0.56, -0.34), (0.45, -0.32), (0.58, -0.22))
"""Where the box may be stood, m (x, y in the world), the best first."""
YAWS = tuple(np.deg2rad(np.arange(-180.0, 180.0, 20.0)).tolist())
"""Directions in which the hand may be on the standing box's side, rad about the vertical."""


@dataclass(frozen=True, slots=True, eq=False)
class Taking:
    """A grip of the lying box, the end cap that it brings up, and the right arm's postures above and lifted."""

    grip: Grip
    end: Face
    above: Vector
    lift: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Where the box will stand (world), the right arm's postures there, and how good they are."""

    X_world_stand: Matrix
    over: Vector
    stand: Vector
    back: Vector
    rank: float


def lies(work: Work) -> bool:
    """Return whether the box is seen and lies on a long face."""
    return abs(float(work.sight.X_world_box[2, work.box.long_axis])) < LYING


def long_face_up(X_world_box: Matrix, box: NominalBox) -> Face:
    """Return the long face that looks up the most."""
    return upper_face(X_world_box, tuple(face for face in FACES if "xyz".index(face[1]) != box.long_axis))


def laid_flat(X_world_box: Matrix, box: NominalBox) -> Matrix:
    """Return the pose nearest to an estimate in which the box rests flat on the table (z = 0) with a long face."""
    up = long_face_up(X_world_box, box)
    n_up, n_end = face_normal(up), np.eye(3)[box.long_axis]
    along = X_world_box[:3, :3] @ n_end
    along = np.array([along[0], along[1], 0.0]) / np.hypot(along[0], along[1])
    z = np.array([0.0, 0.0, 1.0])
    R = np.column_stack([z, along, cross(z, along)]) @ np.column_stack([n_up, n_end, cross(n_up, n_end)]).T
    return transform((X_world_box[0, 3], X_world_box[1, 3], float(np.abs(n_up) @ box.size) / 2), R)


def standing(box: NominalBox, end: Face, beside: Face, place: tuple[float, float], yaw: float) -> Matrix:
    """Return X_world_box standing with the end cap `end` up and the face `beside` looking along `yaw` (rad)."""
    n_end, n_beside = face_normal(end), face_normal(beside)
    z, out = np.array([0.0, 0.0, 1.0]), np.array([np.cos(yaw), np.sin(yaw), 0.0])
    R = np.column_stack([z, out, cross(z, out)]) @ np.column_stack([n_end, n_beside, cross(n_end, n_beside)]).T
    return transform((*place, float(box.size[box.long_axis]) / 2), R)


def away(X_world_palm: Matrix, X_world_box: Matrix, up: Face, distance: float) -> Matrix:
    """Return a palm pose moved off the box along the normal of the face it is over."""
    return transform(distance * (X_world_box[:3, :3] @ face_normal(up))) @ X_world_palm


def top_first(box: NominalBox) -> tuple[Face, Face]:
    """Return the end caps, the top one first: the longest edge points from a box's bottom to its top."""
    bottom, top = end_caps(box.long_axis)
    return top, bottom


def grips(box: NominalBox, up: Face) -> Iterator[tuple[Grip, Face]]:
    """Yield the grips of a lying box with the end cap that comes up."""
    sides: list[Face] = [face for face in long_faces(box.long_axis) if face[1] != up[1]]
    for finger_face, end in product(sides, top_first(box)):
        yield straddle_grip(box.size, up, finger_face, end), end


def takings(work: Work, X_world_box: Matrix, up: Face) -> list[Taking]:
    """Return the ways to take the lying box that the arm reaches; `TaskFailed` says why there is none."""
    found: list[Taking] = []
    causes: list[str] = []
    for grip, end in grips(work.box, up):
        X_grasp = X_world_box @ grip.X_box_palm
        touching = work.collision(exempt=(("right_hand", "box"), ("right_hand", "table")))
        held = work.collision(held=HeldBox("right", inverse(grip.X_box_palm), work.box.size / 2))
        above = work.posture("right", raised(X_grasp, ABOVE_M), work.collision())
        if above is None or work.posture("right", X_grasp, touching, above) is None:
            causes.append(f"grasp over {end} out of reach")
            continue
        lift = work.posture("right", raised(X_grasp, LIFT_M), held, above)
        if lift is None:
            causes.append(f"lift by {end} out of reach")
            continue
        found.append(Taking(grip, end, above, lift))
    if not found:
        raise TaskFailed("unreachable: lying box: " + "; ".join(causes))
    return found


def stand_postures(work: Work, taking: Taking, X_stand: Matrix, up: Face) -> Standing | None:
    """Return the arm's way of standing the box at a pose and drawing back, or None if it cannot."""
    X_palm = X_stand @ taking.grip.X_box_palm
    held = HeldBox("right", inverse(taking.grip.X_box_palm), work.box.size / 2)
    over = work.posture("right", raised(X_palm, OVER_M), work.collision(held=held), taking.lift)
    if over is None:
        return None
    stand = work.posture("right", X_palm, work.collision(held=held, exempt=(("held", "table"),)), over)
    if stand is None:
        return None
    back = work.posture("right", away(X_palm, X_stand, up, AWAY_M), work.collision(), stand)
    if back is None or max(np.abs(stand - over).max(), np.abs(back - stand).max()) > LONGEST_STEP_RAD:
        return None
    worst = min(score("right", q) for q in (over, stand, back))
    travel = float(np.abs(over - taking.lift).max())
    return Standing(X_stand, over, stand, back, min(worst, GOOD_SCORE) / GOOD_SCORE - 0.5 * travel)


def choose_stand(work: Work, X_world_box: Matrix, up: Face) -> Generator[None, None, tuple[Taking, Standing]]:
    """Return the first good way, place by place, or else the best one; top up rather than upside down.

    The lid opens to the same side on each face of a box with its top up; upside down it would open towards the
    other hand. One candidate is looked at in a tick.
    """
    ways = takings(work, X_world_box, up)
    for top in top_first(work.box):
        best: tuple[Taking, Standing] | None = None
        for place in PLACES:
            for taking, yaw in product([way for way in ways if way.end == top], YAWS):
                found = stand_postures(work, taking, standing(work.box, taking.end, up, place, yaw), up)
                if found is not None and (best is None or found.rank > best[1].rank):
                    best = (taking, found)
                yield
            if best is not None and best[1].rank >= GOOD_RANK:
                break
        if best is not None:
            return best
    raise TaskFailed("unreachable: no place to stand the box on an end cap")


def stand_up(work: Work) -> Motion:
    """Stand a lying box on an end cap with the right hand; afterwards the hand is open and off the box."""
    body, hand = work.body, work.hands["right"]
    work.phase = "look"
    if not (yield from wait_for(body, lambda: work.sight.settled, 3.0)):
        raise TaskFailed("unseen: no settled estimate of the box within 3 s")
    if not lies(work):
        return
    yield from wait(body, 0.3)
    # The table tells height and tilt better than the eye.
    X_lying = laid_flat(work.sight.X_world_box, work.box)
    up = long_face_up(X_lying, work.box)
    taking, place = yield from choose_stand(work, X_lying, up)
    grip = taking.grip
    X_grasp = X_lying @ grip.X_box_palm
    work.phase = "travel to lying box"
    yield from lead_fingers(body, "right", grip.preshape)
    yield from work.travel("right", taking.above)
    work.phase = "straddle"
    yield from lead_palm(body, "right", X_grasp, speed=0.06)
    yield from wait(body, 0.2)
    work.phase = "close on lying box"
    yield from hand.close(grip)
    work.sight.hold("right")
    X_box_palm = inverse(X_lying) @ body.asked_palm("right")
    work.phase = "lift lying box"
    body.prefer_posture("right", taking.lift)
    yield from lead_palm(body, "right", raised(X_grasp, LIFT_M), speed=0.10)
    hand.check()
    work.phase = "turn"
    X_stand = place.X_world_stand @ X_box_palm
    yield from work.travel("right", place.over)
    hand.check()
    work.phase = "stand"
    body.prefer_posture("right", place.stand)
    yield from lead_palm(body, "right", raised(X_stand, SET_DOWN_M), speed=0.08)
    yield from wait(body, 0.3)
    yield from hand.open()
    work.sight.release()
    work.phase = "draw back"
    body.prefer_posture("right", place.back)
    yield from lead_palm(body, "right", away(X_stand, place.X_world_stand, up, AWAY_M), speed=0.10)
    yield from wait(body, 0.3)
