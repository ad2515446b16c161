"""Which grip the right hand takes the box with, and the arm postures through it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from itertools import product

import numpy as np

from preshape.control.grip import Grip
from preshape.control.grips import cage_grip
from preshape.control.procedure_areas import components_left, lies_in
from preshape.control.work import Work
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, inverse, raised, transform
from preshape.hal.world import FACES, Face, end_caps, face_normal
from preshape.planner.air_pose import ELSEWHERE, AirPlace, air_pose, upper_face
from preshape.planner.arm_capsules import HeldBox
from preshape.planner.arm_collision import ArmCollision
from preshape.planner.plan_scene import LIFT_M

PREGRASP_M, NEAR_PREGRASP_M = 0.14, 0.12
"""Height of the palm above its grasp pose at which the field takes over, m, and where an obstacle leaves no more."""
STANDOFF_M = 0.11
"""Distance from the grasp pose, back along the palm's z axis, at which the fingertips reach the box's end, m."""
LIFTS_M = (LIFT_M, 0.07)
"""How high the box is lifted, m, the lower one where an obstacle hangs above."""
WAY_POSES = 5
"""Palm poses from the pre-grasp to the grasp for which postures are chosen together."""


@dataclass(frozen=True, slots=True, eq=False)
class GraspChoice:
    """A grip and the right arm's postures through it: pre-grasp, grasp, lift by `lift_m`, showing the likely face."""

    grip: Grip
    finger_face: Face
    likely_face: Face
    pregrasp: Vector
    grasp: Vector
    lift: Vector
    show: Vector
    lift_m: float


def shown_face(grip: Grip) -> Face:
    """Return the face on the palm's -y side: with it to the robot, the fingers lie below and the thumb above."""
    return max(FACES, key=lambda face: float(-grip.X_box_palm[:3, 1] @ face_normal(face)))


def back_off(X_world_palm: Matrix, distance: float) -> Matrix:
    """Return a palm pose moved back along its own z axis."""
    return X_world_palm @ transform((0.0, 0.0, -distance))


def choose_grip(work: Work, likely: Face | None, place: AirPlace, tried: Collection[Face] = ()) -> GraspChoice:
    """Return the reachable grip with the best postures; those that show the likely face well come first.

    Only grips of components that the procedure's areas leave to the hand count, and none that shows a face again which
    has no opening. Those with the fingers on a face of `tried` come last. `TaskFailed` says why there is none.
    """
    choices, causes = reachable_grips(work, place, work.sight.X_world_box, work.body.asked_arm("right"))
    if not choices:
        raise work.no_way("; ".join(causes) or "no grip suits the box")

    def rank(choice: GraspChoice) -> float:
        bonus = 100.0 if likely is not None and choice.likely_face == likely else 0.0
        travel = float(np.abs(choice.grasp - work.body.asked_arm("right")).max())
        return bonus - travel - 1000.0 * (choice.finger_face in tried)

    return max(choices, key=rank)


def reachable_grips(
    work: Work, place: AirPlace, X_world_box: Matrix, near: Vector
) -> tuple[list[GraspChoice], list[str]]:
    """Return the grips that reach a box standing at a pose, with the arm near a posture (7), and why others do not."""
    end = upper_face(X_world_box, end_caps(work.box.long_axis))
    left = components_left(work.box, None, {}, "right", 1)
    choices: list[GraspChoice] = []
    causes: list[str] = []
    for finger_face in work.box.closed_sides:
        try:
            grip = cage_grip(work.box.size, end, finger_face, "right")
        except ValueError as error:
            causes.append(f"fingers on {finger_face}: {error}")
            continue
        if not lies_in(grip, left):
            causes.append(f"fingers on {finger_face}: none of the components left to the right hand")
            continue
        if shown_face(grip) in work.blank:
            causes.append(f"fingers on {finger_face}: shows {shown_face(grip)}, which has no opening")
            continue
        choice = _postures(work, grip, finger_face, end, place, X_world_box, near)
        if isinstance(choice, str):
            causes.append(f"fingers on {finger_face}: {choice}")
            continue
        choices.append(choice)
    return choices, causes


def _postures(
    work: Work, grip: Grip, finger_face: Face, end: Face, place: AirPlace, X_world_box: Matrix, near: Vector
) -> GraspChoice | str:
    """Return one grip's chain of postures, each near the one before, or what is out of reach."""
    X_grasp = X_world_box @ grip.X_box_palm
    face = shown_face(grip)
    held = HeldBox("right", inverse(grip.X_box_palm), work.box.size / 2)
    carried = shown = work.collision(held=held)
    # Among obstacles it counts how the fingers will be; elsewhere the hand as it is does.
    fingers = grip.opened if work.sight.obstacles else None
    coming = work.collision(standing=X_world_box, fingers=fingers)
    around = work.collision(exempt=(("right_hand", "box"),), standing=X_world_box, fingers=fingers)
    lift_m = LIFT_M
    shifts = ELSEWHERE[:1]
    if work.sight.obstacles:
        # Where the box is shown the hand will also open.
        shifts, shown = ELSEWHERE, work.collision(held=held, fingers=grip.opened)
        way = _way(work, X_grasp, (coming, around, carried), near)
        if way is None:
            return "no way around the box and up that keeps clear"
        pregrasp, grasp, lift, lift_m = way
    else:
        pregrasp = work.posture("right", back_off(X_grasp, PREGRASP_M), coming, near)
        if pregrasp is None:
            return "pre-grasp pose out of reach"
        grasp = work.posture("right", X_grasp, around, pregrasp)
        if grasp is None:
            return "grasp pose out of reach"
        lift = work.posture("right", raised(X_grasp, lift_m), carried, grasp)
        if lift is None:
            return "lift pose out of reach"
    palms = (transform(shift) @ air_pose(place, end, face) @ grip.X_box_palm for shift in shifts)
    show = next((q for X in palms if (q := work.posture("right", X, shown, lift)) is not None), None)
    if show is None:
        return "show pose out of reach"
    return GraspChoice(grip, finger_face, face, pregrasp, grasp, lift, show, lift_m)


def _way(
    work: Work,
    X_grasp: Matrix,
    models: tuple[ArmCollision, ArmCollision, ArmCollision],
    near: Vector,
) -> tuple[Vector, Vector, Vector, float] | None:
    """Return postures at pre-grasp, grasp and lift, and its height, that keep clear of obstacles all the way.

    Chosen one by one they may keep clear, and the arm in between not. `models` are for the hand before the box, around
    it, and with it. Nearer than the near pre-grasp a hand that comes fast would touch the box.
    """
    coming, around, carried = models
    for lift_m, distance in product(LIFTS_M, (PREGRASP_M, NEAR_PREGRASP_M)):
        inside = np.linspace(distance, 0.0, WAY_POSES)
        palms = np.array([*(back_off(X_grasp, d) for d in inside), raised(X_grasp, lift_m)])
        chain = work.way("right", palms, [coming, *[around] * (WAY_POSES - 1), carried], near)
        if chain is not None:
            return chain[0], chain[WAY_POSES - 1], chain[-1], lift_m
    return None
