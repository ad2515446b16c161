"""Task 1: take the box from the table with the right hand."""

from __future__ import annotations

from collections.abc import Collection, Generator

import numpy as np

from preshape.control.approach import FieldGuide, approach, insert
from preshape.control.failure import TaskFailed
from preshape.control.grasp_choice import STANDOFF_M, GraspChoice, back_off, choose_grip
from preshape.control.motions import Motion, between, eased, lead_fingers, lead_palm, ticks, together, wait, wait_for
from preshape.control.opening_finder import GLANCE_VIEW_ANGLE, Verdict, decide, find_opening
from preshape.control.work import Work
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, inverse, raised, transform
from preshape.hal.world import Face
from preshape.planner.air_pose import AirPlace

ASIDE_M = 0.008
"""How much further than on coming a leaving palm keeps its fingers off their face, m: the thumb's side has room."""
REACHES = 4
"""How often the hand sets out for the box."""
AIM_ANEW_S = 0.6
"""Time until the hand sets out again: it comes to rest, and what is seen settles, s."""
BACK_M = 0.10
"""How far a hand that has stalled draws back along its axis, m."""


def glance(work: Work) -> Face | None:
    """Look at the box where it stands; return the face that carries the opening if it can be told.

    One glance cannot measure the opening (task 2 does); it only tells which face to show first.
    """
    image = work.sight.image()
    matches = find_opening(image, work.sight.X_world_box, work.box, work.known_look(), max_view_angle=GLANCE_VIEW_ANGLE)
    decision = decide(matches)
    if decision.verdict in (Verdict.FOUND, Verdict.AMBIGUOUS) and decision.match is not None:
        return decision.match.opening.face
    seen = set(decision.faces) if decision.verdict is Verdict.NOT_HERE else set()
    left: list[Face] = [face for face in work.box.candidate_faces if face not in seen]
    return left[0] if len(left) == 1 else None


def aim(
    work: Work, likely: Face | None, place: AirPlace, tried: Collection[Face]
) -> Generator[None, None, GraspChoice]:
    """Look until the box is seen where it stays, and choose a grip of it."""
    work.phase = "look"
    settled = yield from wait_for(work.body, lambda: work.sight.settled, 3.0)
    if not settled:
        raise TaskFailed("unseen: no settled estimate of the box within 3 s")
    yield from wait(work.body, 0.3)
    likely = likely or glance(work)
    work.notes.append(f"glance: {likely or 'cannot tell'}")
    return choose_grip(work, likely, place, tried)


def surround(work: Work, guide: FieldGuide, choice: GraspChoice) -> Motion:
    """Bring the open hand to the box and around it; `TaskFailed` moved: the box is seen elsewhere meanwhile."""
    work.phase = "travel"
    yield from while_it_stays(work, come_near(work, guide, choice))
    work.phase = "insert"
    coming = insert(guide, work.body, work.sight, "right", choice.grip.X_box_palm_insert, choice.grip.preshape)
    yield from while_it_stays(work, coming)


def while_it_stays(work: Work, motion: Motion) -> Motion:
    """Run a motion; `TaskFailed` moved as soon as the box is seen elsewhere: the hand must not follow it there."""
    jumps = work.sight.jumps
    for _ in motion:
        if work.sight.jumps != jumps:
            raise TaskFailed("moved: the box is seen elsewhere than where the hand goes")
        yield


def come_near(work: Work, guide: FieldGuide, choice: GraspChoice) -> Motion:
    """Travel to the pre-grasp, then let the field bring the fingertips to the box's end."""

    def note(phase: str) -> None:
        work.phase = phase

    yield from work.make_room("right", choice.grip.opened)
    yield from lead_fingers(work.body, "right", choice.grip.preshape)
    yield from work.travel("right", choice.pregrasp)
    work.body.prefer_posture("right", choice.grasp)
    yield from approach(
        guide, work.body, work.sight, "right", back_off(choice.grip.X_box_palm_insert, STANDOFF_M),
        choice.grip.preshape, note=note,
    )  # fmt: skip


def reach_box(
    work: Work, guide: FieldGuide, likely: Face | None, place: AirPlace
) -> Generator[None, None, GraspChoice]:
    """Aim and bring the open hand around the box; aim anew when the box turns out elsewhere or something is in the way.

    Nothing has been touched yet, so the hand can draw back along its own axis and come again, by another grip if
    there is one.
    """
    tried: list[Face] = []
    for left in reversed(range(REACHES)):
        choice: GraspChoice | None = None
        try:
            choice = yield from aim(work, likely, place, tried)
            yield from surround(work, guide, choice)
            return choice
        except TaskFailed as failed:
            if not left or failed.kind not in ("stalled", "moved", "unreachable"):
                raise
            work.notes.append(f"reach: {failed.cause}; aim anew")
            if choice is not None and failed.kind == "stalled":
                tried.append(choice.finger_face)
            if choice is not None and work.phase != "travel":
                yield from lead_palm(work.body, "right", back_off(work.body.palm("right"), BACK_M), speed=0.05)
        yield from wait(work.body, AIM_ANEW_S)
    raise AssertionError("the last try returns or raises")


def grasp_box(work: Work, guide: FieldGuide, likely: Face | None, place: AirPlace) -> Motion:
    """Approach, close and lift; the grip is kept in `work.grips`."""
    choice = yield from reach_box(work, guide, likely, place)
    work.grips["right"] = choice.grip
    hand = work.hands["right"]
    work.phase = "lay on"
    yield from lead_palm(work.body, "right", work.sight.X_world_box @ choice.grip.X_box_palm, speed=0.02)
    work.phase = "close"
    work.stood_at, work.taken_at = work.sight.X_world_box, work.body.asked_palm("right")
    yield from hand.close(choice.grip)
    work.sight.hold("right")
    work.phase = "lift"
    work.body.prefer_posture("right", choice.lift)
    X_lift = raised(work.body.asked_palm("right"), choice.lift_m)
    yield from lead_palm(work.body, "right", X_lift, speed=0.12)
    hand.check()


def take_off(work: Work, side: Side, distance: float) -> Motion:
    """Open a hand and take it off the box: sideways, off the face its fingers lie on, then back along its axis.

    The palm goes while the fingers open, since straight fingers have nowhere else to go, and a box that is let go
    may follow them. It keeps its attitude to the box: the fingers lie along the faces as they are, which the estimate
    tells to a degree or two only. Both lines are held in the box's frame, as it gives way in the other hand.
    """
    grip = work.grips[side]
    X_held = inverse(work.sight.X_world_box) @ work.body.asked_palm(side)
    beside = (inverse(grip.X_box_palm) @ grip.X_box_palm_insert)[:3, 3] - (ASIDE_M, 0.0, 0.0)
    X_off = X_held @ transform(beside)
    work.phase = "release"
    yield from together(work.hands[side].open(), lead_off(work, side, X_off, speed=0.02))
    work.phase = "retreat"
    try:
        yield from lead_off(work, side, back_off(X_off, distance), speed=0.10)
    except TaskFailed as failed:
        # What the hand may touch it has left; whatever comes next finds its own way from here.
        if failed.kind != "stalled":
            raise
        work.notes.append(f"retreat: {failed.cause}; cut short")


def lead_off(work: Work, side: Side, X_box_palm: Matrix, speed: float) -> Motion:
    """Lead a palm on a straight line in the box's frame, as the box is seen meanwhile, at a peak speed (m/s)."""
    X_start = inverse(work.sight.X_world_box) @ work.body.asked_palm(side)
    distance = float(np.linalg.norm(X_box_palm[:3, 3] - X_start[:3, 3]))
    count = ticks(work.body, max(15.0 / 8.0 * distance / speed, 0.2))
    for k in range(1, count + 1):
        work.body.ask_palm(side, work.sight.X_world_box @ between(X_start, X_box_palm, eased(k / count)))
        yield
