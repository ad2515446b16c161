"""Task 2: show the box to the camera and find the opening area in the image."""

from __future__ import annotations

from collections.abc import Generator

from preshape.control.failure import TaskFailed
from preshape.control.motions import Motion, wait
from preshape.control.object_filter import BoxEstimate
from preshape.control.opening_finder import Decision, PosePrior, Verdict, decide, find_opening
from preshape.control.work import Work
from preshape.hal.transform import transform
from preshape.hal.world import Face
from preshape.planner.air_pose import ELSEWHERE, AirPlace, air_pose

LOOKS = 3
"""How often an ambiguous image is taken anew."""
STILL_S = 0.4
"""How long the box rests before an image is taken, s."""
PRIOR = PosePrior(0.0015, 0.026)
"""How far the filtered estimate of a held box may be off, m and rad."""


def show_face(work: Work, face: Face, end: Face, place: AirPlace) -> Motion:
    """Turn the held box so that a face looks at the camera; elsewhere if an obstacle leaves no way to the place."""
    X_palm = air_pose(place, end, face) @ work.grips["right"].X_box_palm
    for shift in ELSEWHERE:
        try:
            yield from work.carry_to_palm("right", transform(shift) @ X_palm, speed=0.30)
            break
        except TaskFailed as failed:
            if shift == ELSEWHERE[-1] or failed.kind != "stalled":
                raise
            work.notes.append(f"show: {failed.cause}; shown elsewhere")
    yield from wait(work.body, STILL_S)


def look(work: Work) -> Decision:
    """Take an image and decide what it shows."""
    estimate: BoxEstimate | None = work.sight.estimate
    if estimate is None:
        raise TaskFailed("unseen: the box has no estimate")
    return decide(find_opening(work.sight.image(), estimate.X_world_box, work.box, work.known_look(), PRIOR))


def find_opening_area(work: Work, face: Face, end: Face, place: AirPlace) -> Generator[None, None, bool]:
    """Show a candidate face and look for the opening on it; keeps it in `work.opening`, returns whether it was found.

    Only the face that this grip turns to the robot is shown: turned the other way round the box would hang on the
    thumb, and could be opened only after being taken anew.
    """
    work.phase = f"show {face}"
    yield from show_face(work, face, end, place)
    work.phase = f"look at {face}"
    for _ in range(LOOKS):
        decision = look(work)
        work.notes.append(f"face {face}: {decision.verdict.value}")
        if decision.verdict is Verdict.FOUND and decision.match is not None:
            work.sight.correct(work.body.now_ns, decision.match.X_world_box)
            work.opening = decision.match.opening
            work.seen_at = decision.match.X_world_box
            yield
            return True
        if decision.verdict is Verdict.NOT_HERE:
            yield
            return False
        yield from wait(work.body, STILL_S)
    return False
