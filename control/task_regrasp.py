"""Task 3: the left hand takes the box by its free end, then the right hand lets go."""

from __future__ import annotations

import numpy as np

from preshape.control.approach import FieldGuide, approach, insert
from preshape.control.carrier import Carrier, sweep
from preshape.control.failure import TaskFailed
from preshape.control.grasp_choice import STANDOFF_M, back_off, shown_face
from preshape.control.grip import Grip
from preshape.control.grips import SPARE_M, brace_grip
from preshape.control.motions import Motion, lead_fingers, lead_palm, wait
from preshape.control.procedure_areas import components_left, lies_in
from preshape.control.task_grasp import BACK_M, take_off
from preshape.control.work import Work
from preshape.hal.state import Vector
from preshape.hal.transform import inverse, transform
from preshape.hal.world import Face, opposite
from preshape.planner.air_pose import ELSEWHERE
from preshape.planner.arm_chain import posture_chain

PREGRASP_M = 0.14
"""Distance of the left palm from its grasp pose at which the field takes over, m."""
WAY_POSES = 6
"""Palm poses from the pre-grasp to the grasp of a box at rest for which postures are chosen together."""
STILL_S = 0.4
"""How long the box rests after it has been moved aside, s."""
EASED = 0.6
"""Share of its torques that the right hand keeps while the left closes: both press on the same two panels."""
TIGHTENED = 1.15
"""Share of its torques that the left hand holds with once it presses on its panels alone."""
RETREAT_M = 0.16
"""How far the right hand draws back along its own axis, m."""


def carried(work: Work, carrier: Carrier, motion: Motion) -> Motion:
    """Run a motion while the holding hand is led on."""
    for _ in motion:
        carrier.step(work.sight.X_world_box)
        yield


def settle(work: Work, grip: Grip, carrier: Carrier) -> Motion:
    """Keep the left hand around the box until the box has come to rest."""
    while not carrier.stopped:
        work.body.ask_palm("left", carrier.ahead(work.sight.X_world_box) @ grip.X_box_palm_insert)
        yield


def reach_end(work: Work, guide: FieldGuide, grip: Grip) -> Motion:
    """Bring the open left hand around the free end; where there is no way, hold the box elsewhere and try again.

    Nothing has been touched yet, so the left hand can draw back and come again, by postures that lead all the way.
    """
    X_palm = work.body.asked_palm("right")
    for place in ELSEWHERE:
        try:
            if any(place):
                work.phase = "move aside"
                yield from work.carry_to_palm("right", transform(place) @ X_palm)
                yield from wait(work.body, STILL_S)
            yield from surround_end(work, guide, grip, again=any(place))
            return
        except TaskFailed as failed:
            if place == ELSEWHERE[-1] or failed.kind not in ("stalled", "unreachable", "timed out"):
                raise
            work.notes.append(f"reach end: {failed.cause}; held elsewhere")
            if work.phase not in ("travel", "move aside"):
                yield from lead_palm(work.body, "left", back_off(work.body.palm("left"), BACK_M), speed=0.05)


def _postures(work: Work, grip: Grip) -> tuple[Vector, Vector]:
    """Return the left arm's postures (7) at the pre-grasp and the grasp of a box at rest."""
    X_grasp = work.sight.X_world_box @ grip.X_box_palm
    touching = (("left_hand", "held"), ("left_hand", "right_hand"), *work.at_rest("left"))
    q_grasp = work.posture("left", X_grasp, work.collision(touching) if work.sight.obstacles else None)
    if q_grasp is None:
        raise work.no_way("the left hand's grasp at the free end")
    q_start = work.posture("left", back_off(X_grasp, PREGRASP_M), near=q_grasp)
    if q_start is None:
        raise work.no_way("the left hand's pre-grasp")
    return q_start, q_grasp


def _following(work: Work, grip: Grip) -> tuple[Vector, Vector] | None:
    """Return such postures, chosen for the whole way and for all places of a box that moves; None if there are none.

    A posture chosen for the way's end, or for the middle of the sweep alone, may meet a joint limit before.
    """
    X_world_box, moves = work.sight.X_world_box, work.carry.moves
    boxes = sweep(X_world_box, work.carry) if moves else [X_world_box]
    # What a box sweeps is wider than the way to it: there the way's two ends will do.
    way = np.linspace(PREGRASP_M, 0.0, 2 if moves else WAY_POSES)
    palms = [X @ back_off(grip.X_box_palm, d) for d in way for X in boxes]
    base, near = work.cell.X_world_base["left"], work.body.asked_arm("left")
    chain = posture_chain("left", base, np.array(palms), near)
    return None if chain is None else (chain[0], chain[-len(boxes)])


def surround_end(work: Work, guide: FieldGuide, grip: Grip, again: bool = False) -> Motion:
    """Bring the open left hand to the free end and around it, with a box that may move, and wait until it rests."""
    body = work.body
    work.phase = "travel"
    following = _following(work, grip) if work.carry.moves or again else None
    q_start, q_grasp = following or _postures(work, grip)
    yield from work.make_room("left", grip.opened)
    yield from lead_fingers(body, "left", grip.preshape)
    yield from work.travel("left", q_start)
    body.prefer_posture("left", q_grasp)

    carrier = Carrier(body, "right", inverse(body.palm("right")) @ work.sight.X_world_box, work.carry)

    def note(phase: str) -> None:
        work.phase = phase

    X_standoff = back_off(grip.X_box_palm_insert, STANDOFF_M)
    yield from carried(
        work, carrier, approach(guide, body, work.sight, "left", X_standoff, grip.preshape, carrier, note=note)
    )
    work.phase = "insert"
    yield from carried(
        work, carrier, insert(guide, body, work.sight, "left", grip.X_box_palm_insert, grip.preshape, carrier)
    )
    carrier.stop()
    work.phase = "settle"
    yield from carried(work, carrier, settle(work, grip, carrier))


def regrasp(work: Work, guide: FieldGuide, held_end: Face) -> Motion:
    """Bring the left hand to the free end cap, close it, open the right hand and draw it back."""
    if work.opening is None:
        raise TaskFailed("unseen: the opening area is not known")
    body = work.body
    same_face = shown_face(work.grips["right"]) != work.opening.face
    back = SPARE_M if same_face else 0.0
    try:
        grip = brace_grip(work.box.size, opposite(held_end), work.opening.face, "left", back)
    except ValueError as error:
        raise TaskFailed(f"no span: opening on {work.opening.face}: {error}") from error
    left = components_left(work.box, work.opening, {"right": work.grips["right"]}, "left", 3)
    if not lies_in(grip, left):
        raise TaskFailed("unreachable: a brace of the free end is none of the components left to the left hand")
    yield from reach_end(work, guide, grip)
    work.phase = "lay on"
    yield from lead_palm(body, "left", work.sight.X_world_box @ grip.X_box_palm, speed=0.02)
    work.phase = "close"
    work.hands["right"].ease(EASED)
    yield from work.hands["left"].close(grip)
    yield from wait(body, 0.2)
    work.grips["left"] = grip
    work.sight.hold("left")
    yield from take_off(work, "right", RETREAT_M)
    work.hands["left"].check()
    work.hands["left"].ease(TIGHTENED)
    yield from wait(body, 0.5)
