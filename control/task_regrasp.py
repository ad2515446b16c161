"""Task 3: the left hand takes the box by its free end, then the right hand lets go."""

from __future__ import annotations

from preshape.control.approach import FieldGuide, approach, insert
from preshape.control.carrier import Carrier
from preshape.control.failure import TaskFailed
from preshape.control.grips import SPARE_M, Grip, brace_grip
from preshape.control.motions import Motion, lead_fingers, lead_palm, wait
from preshape.control.task_grasp import STANDOFF_M, back_off, draw_back, shown_face
from preshape.control.work import Work
from preshape.hal.transform import inverse
from preshape.hal.world import Face, opposite

PREGRASP_M = 0.14
"""Distance of the left palm from its grasp pose at which the field takes over, m."""
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


def regrasp(work: Work, guide: FieldGuide, held_end: Face) -> Motion:
    """Bring the left hand to the free end cap, close it, open the right hand and draw it back."""
    if work.opening is None:
        raise TaskFailed("unseen: the opening area is not known")
    body = work.body
    same_face = shown_face(work.grips["right"]) != work.opening.face
    back = SPARE_M if same_face else 0.0
    grip = brace_grip(work.box.size, opposite(held_end), work.opening.face, "left", back)
    work.phase = "travel"
    X_grasp = work.sight.X_world_box @ grip.X_box_palm
    q_grasp = work.posture("left", X_grasp)
    if q_grasp is None:
        raise TaskFailed("unreachable: the left hand's grasp at the free end")
    q_start = work.posture("left", back_off(X_grasp, PREGRASP_M), near=q_grasp)
    if q_start is None:
        raise TaskFailed("unreachable: the left hand's pre-grasp")
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
    work.phase = "lay on"
    yield from lead_palm(body, "left", work.sight.X_world_box @ grip.X_box_palm, speed=0.02)
    work.phase = "close"
    work.hands["right"].ease(EASED)
    yield from work.hands["left"].close(grip)
    yield from wait(body, 0.2)
    work.grips["left"] = grip
    work.sight.hold("left")
    work.phase = "release"
    yield from work.hands["right"].open()
    work.phase = "retreat"
    yield from draw_back(work, "right", RETREAT_M)
    work.hands["left"].check()
    work.hands["left"].ease(TIGHTENED)
    yield from wait(body, 0.5)
