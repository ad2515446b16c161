"""Whether a hand can use a component in a task: faces, span, closure, clearance, arm reach, view (section III-C)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, inverse, transform
from preshape.hal.world import Face, OrientedBox, face_normal
from preshape.planner.arm_ik import IkGrid
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.arm_reach import Reach, ReachQuery, ReachStatus, reach
from preshape.planner.component import Component
from preshape.planner.grasp_option import GraspOption, grasp_options
from preshape.planner.hand_clearance import box_distance, hand_clearance
from preshape.planner.plan_scene import PlanScene, Poses
from preshape.planner.procedure import SIDE_OF, Hand, Place, Task
from preshape.planner.sections import Sections
from preshape.planner.sight_line import hidden_share, rectangle_points
from preshape.planner.work_object import WorkPart

PREGRASP_M = 0.14
"""Distance of the palm from its grasp pose, back along its z axis, from which it comes and to which it leaves, m."""

COVERED_M = 0.005
"""A patch or a contact this close to another body cannot be used, m."""

BODY_CLEARANCE_M = 0.005
"""Clearance that a hand at its preshape keeps from the table and other bodies, m."""

HIDDEN_MAX = 0.25
"""Largest share of the search area that the holding hand may hide from the camera."""

_QUERY = ReachQuery(grid=IkGrid(q7_samples=41))


@lru_cache(maxsize=4096)
def _posture(side: Side, X_world_base: bytes, X_world_palm: bytes) -> Reach:
    X_base, X_palm = (np.frombuffer(X).reshape(4, 4) for X in (X_world_base, X_world_palm))
    found = reach(side, X_base, X_palm, query=_QUERY)
    found.q.setflags(write=False)
    return found


def posture(side: Side, X_world_base: Matrix, X_world_palm: Matrix) -> Reach:
    """Return an arm's best posture for a palm pose; places in the air are asked for plan after plan and kept."""
    return _posture(side, np.ascontiguousarray(X_world_base).tobytes(), np.ascontiguousarray(X_world_palm).tobytes())


@dataclass(frozen=True, slots=True, eq=False)
class ArmPose:
    """A place where a hand holds the object: the object, the palm, the arm's joints (7) rad and their score.

    `face`: the one that is taken to carry the opening there, None where that does not matter.
    """

    place: Place
    face: Face | None
    X_world_object: Matrix
    X_world_palm: Matrix
    q_arm: Matrix
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class Assessment:
    """What speaks against an option in one place (nothing: an empty text); else how it can be used there.

    `poses`: by the face that may carry the opening, None where that does not matter; faces that the hand cannot
    serve are left out, and without any the option is refused. `hidden_share`: of the search area, at worst.
    """

    refusal: str
    poses: Mapping[Face | None, ArmPose] = field(default_factory=dict[Face | None, ArmPose])
    hidden_share: float = 0.0


@dataclass(frozen=True, slots=True)
class Refusal:
    """An option that a hand cannot use: in which place, and why."""

    hand: Hand
    option: str
    place: Place
    reason: str

    def __str__(self) -> str:
        return f"{SIDE_OF[self.hand]} hand, {self.option}, {self.place}: {self.reason}"


class Availability:
    """The options of both hands on one part in one scene, each assessed once, when it is asked for."""

    def __init__(self, scene: PlanScene, part: WorkPart, sections: Sections) -> None:
        """Keep the scene; nothing is computed yet."""
        self.scene, self.part, self.sections = scene, part, sections
        self._options: dict[tuple[Hand, Component], tuple[GraspOption, ...]] = {}
        self._reasons: dict[tuple[Hand, str], str] = {}
        self._assessed: dict[tuple[Hand, str, Place], Assessment] = {}
        self._withdrawn: dict[tuple[Hand, str], str] = {}

    def options(self, hand: Hand, component: Component) -> tuple[GraspOption, ...]:
        """Return a component's options, thumb on either face; only the one in use if the hand holds the object."""
        key = (hand, component)
        if key not in self._options:
            side = SIDE_OF[hand]
            both = grasp_options(self.part, self.sections, component, side, self.scene.q_hands[side])
            held = self.scene.held
            if held is not None and held.hand == hand:
                both = tuple(o for o in both if (o.component, o.thumb_face) == (held.component, held.thumb_face))
            self._options[key] = both
        return self._options[key]

    def usable(self, hand: Hand, task: Task, component: Component) -> bool:
        """Return whether some option of a component serves a hand in a task; the planner of areas asks this."""
        return any(not self.assess(hand, task.place, option).refusal for option in self.options(hand, component))

    def withdraw(self, hand: Hand, option: GraspOption, reason: str) -> None:
        """From now on the option is refused: something that only shows with both hands in place speaks against it."""
        self._withdrawn[hand, str(option)] = reason

    def is_withdrawn(self, hand: Hand, option: GraspOption) -> bool:
        """Return whether an option has been withdrawn."""
        return (hand, str(option)) in self._withdrawn

    @property
    def withdrawn(self) -> int:
        """How many options have been withdrawn."""
        return len(self._withdrawn)

    def refusals(self) -> tuple[Refusal, ...]:
        """Return what has been found to speak against options so far."""
        found = {key: a.refusal for key, a in self._assessed.items() if a.refusal}
        return tuple(Refusal(hand, option, place, reason) for (hand, option, place), reason in found.items())

    def assess(self, hand: Hand, place: Place, option: GraspOption) -> Assessment:
        """Return what speaks against an option in a place, or the arm's poses there."""
        name = str(option)
        if (hand, name) in self._withdrawn:
            return Assessment(self._withdrawn[hand, name])
        key = (hand, name, place)
        if key not in self._assessed:
            self._assessed[key] = self._found(hand, place, option)
        return self._assessed[key]

    def _found(self, hand: Hand, place: Place, option: GraspOption) -> Assessment:
        held = self.scene.held
        if held is not None and held.hand == hand:
            return Assessment("")
        reason = self._reason(hand, option)
        if not reason and place == "here":
            reason = self._blocked_here(option)
        if reason:
            return Assessment(reason)
        poses: dict[Face | None, ArmPose] = {}
        hidden = [0.0]
        for face, alternatives in self.scene.object_poses(self.part, hand, option.component, place).items():
            pose = self._reached(hand, place, face, option, alternatives)
            if pose is None:
                reason = "out of the arm's reach"
                continue
            if place == "shown" and face is not None:
                share = self._hidden(option, pose, face)
                if share > HIDDEN_MAX:
                    reason = f"hides {share:.0%} of the search area from the camera"
                    continue
                hidden.append(share)
            poses[face] = pose
        return Assessment("" if poses else reason, poses, max(hidden))

    def _reason(self, hand: Hand, option: GraspOption) -> str:
        """Return what speaks against an option wherever the object is."""
        key = (hand, str(option))
        if key not in self._reasons:
            self._reasons[key] = next(self._faults(option), "")
        return self._reasons[key]

    def _faults(self, option: GraspOption) -> Iterator[str]:
        others = self.scene.target.boxes(np.eye(4), self.part)
        covering = self._covering(option, np.eye(4), others)
        if covering:
            yield f"covered by {covering}"
        if not option.preshape.reached:
            width, miss = option.box.grasped_width * 1e3, option.preshape.residual_m * 1e3
            yield f"beyond the hand's span: {width:.0f} mm between the faces, fingertips miss by {miss:.0f} mm"
        boxes = self.scene.target.boxes(np.eye(4))
        distance, name = hand_clearance(option.side, option.X_object_palm, option.q_hand, boxes)
        if distance < 0.0:
            yield f"the hand would overlap the object's {name} by {-distance * 1e3:.0f} mm"
        if not (option.closure.by_line and option.closure.by_cones):
            yield "no force closure"

    def _blocked_here(self, option: GraspOption) -> str:
        X = self.scene.X_world_object
        covering = self._covering(option, X, self.scene.bodies)
        if covering:
            return f"face on the {covering}"
        distance, name = hand_clearance(option.side, X @ option.X_object_palm, option.q_hand, self.scene.bodies)
        return (
            f"the hand would come within {distance * 1e3:.0f} mm of the {name}" if distance < BODY_CLEARANCE_M else ""
        )

    def _covering(self, option: GraspOption, X_world_object: Matrix, bodies: tuple[OrientedBox, ...]) -> str:
        """Return the body that lies on the palm's patch or on a contact, or an empty text."""
        lower, upper = self.sections.rectangle((option.component.section, option.palm_face))
        X = self.part.X_object_part
        points = np.vstack([X[:3, :3] @ (lower + upper) / 2.0 + X[:3, 3], option.contacts_object])
        in_world = points @ X_world_object[:3, :3].T + X_world_object[:3, 3]
        for body in bodies:
            Y = inverse(body.X_world_box)
            if box_distance(in_world @ Y[:3, :3].T + Y[:3, 3], body.half).min() < COVERED_M:
                return body.name
        return ""

    def _reached(
        self, hand: Hand, place: Place, face: Face | None, option: GraspOption, alternatives: Poses
    ) -> ArmPose | None:
        side = SIDE_OF[hand]
        X_world_base = self.scene.cell.X_world_base[side]
        for X_world_object in alternatives:
            X_palm = X_world_object @ option.X_object_palm
            found = posture(side, X_world_base, X_palm)
            if found.status is not ReachStatus.REACHABLE:
                continue
            if place in ("here", "passed on", "handed over"):
                X_before = X_palm @ transform((0.0, 0.0, -PREGRASP_M))
                if posture(side, X_world_base, X_before).status is not ReachStatus.REACHABLE:
                    continue
            return ArmPose(place, face, X_world_object, X_palm, found.q, found.score)
        return None

    def _hidden(self, option: GraspOption, pose: ArmPose, face: Face) -> float:
        X_world_part = pose.X_world_object @ self.part.X_object_part
        R, p = X_world_part[:3, :3], X_world_part[:3, 3]
        points = rectangle_points(*self.sections.rectangle((1, face))) @ R.T + p
        eye = self.scene.cell.camera.X_world_camera[:3, 3]
        if np.mean(eye - points, axis=0) @ R @ face_normal(face) <= 0.0:
            return 1.0
        return hidden_share(eye, points, option.side, pose.X_world_palm, option.q_hand)

    def palm_now(self, hand: Hand) -> Matrix:
        """Return X_world_palm of a hand before it starts."""
        side = SIDE_OF[hand]
        arm = self.scene.q_arms[:7] if side == "right" else self.scene.q_arms[7:]
        return palm_pose(side, self.scene.cell.X_world_base[side], arm)
