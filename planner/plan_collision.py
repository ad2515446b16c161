"""Whether an option keeps arms and hands apart from everything: the coarse shapes of both arms, one place at a time."""

from __future__ import annotations

from collections.abc import Iterable

from preshape.hal.layout import ARM_DOF, SIDES, Side
from preshape.hal.transform import Matrix, inverse
from preshape.planner.arm_capsules import HeldBox
from preshape.planner.arm_collision import ArmCollision
from preshape.planner.arm_ik import IkGrid
from preshape.planner.arm_reach import ReachQuery, ReachStatus, reach
from preshape.planner.availability import ArmPose, posture
from preshape.planner.grasp_option import GraspOption
from preshape.planner.plan_scene import PlanScene
from preshape.planner.procedure import SIDE_OF, Hand

MARGIN_M = 0.005
"""Clearance of the coarse shapes, m."""

_QUERY = ReachQuery(grid=IkGrid(q7_samples=41), margin_m=MARGIN_M)


class PlanCollision:
    """Looks at the moments that a grasp is for: when the hand takes the object, alone or beside the other hand."""

    def __init__(self, scene: PlanScene) -> None:
        """Keep the scene."""
        self.scene = scene

    def between(
        self, hand: Hand, option: GraspOption, poses: tuple[ArmPose, ...], others: Iterable[GraspOption]
    ) -> str:
        """Return what an option collides with, an empty text if nothing; `others` are what the other hand has then."""
        if self.scene.held is None:
            for pose in poses:
                if pose.place == "here":
                    return self._collision(SIDE_OF[hand], option, pose.X_world_object, None)
        for other in others:
            collision = self._beside(hand, option, poses, other)
            if collision:
                return collision
        return ""

    def _beside(self, hand: Hand, option: GraspOption, poses: tuple[ArmPose, ...], other: GraspOption) -> str:
        if any(pose.place == "passed on" for pose in poses):
            alternatives = self.scene.object_poses(option.part, hand, option.component, "passed on")[None]
        else:
            alternatives = [pose.X_world_object for pose in poses if pose.place == "handed over"][:1]
        collision = ""
        for X_world_object in alternatives:
            collision = self._collision(SIDE_OF[hand], option, X_world_object, other)
            if not collision:
                return ""
        return collision

    def _collision(self, side: Side, option: GraspOption, X_world_object: Matrix, other: GraspOption | None) -> str:
        scene, X_palm = self.scene, X_world_object @ option.X_object_palm
        q_arms = scene.q_arms.copy()
        q_hands: dict[Side, Matrix] = {**scene.q_hands, side: option.q_hand}
        if other is None:
            obstacles = (*scene.obstacles, *scene.target.boxes(X_world_object))
            held, exempt = None, [(f"{side}_hand", part.name) for part in scene.target.parts]
        else:
            X_other = X_world_object @ other.X_object_palm
            found = posture(other.side, scene.cell.X_world_base[other.side], X_other)
            if found.status is not ReachStatus.REACHABLE:
                return f"the {other.side} arm does not reach a place that suits both"
            q_hands[other.side], q_arms[_arm(other.side)] = other.q_hand, found.q
            X_palm_part = inverse(other.X_object_palm) @ other.part.X_object_part
            obstacles, held = scene.obstacles, HeldBox(other.side, X_palm_part, other.part.half)
            exempt = [(f"{side}_hand", "held")]
        model = ArmCollision(scene.cell, q_hands, held, obstacles, exempt)
        reached = reach(side, scene.cell.X_world_base[side], X_palm, model, q_arms, _QUERY)
        if reached.status is ReachStatus.REACHABLE:
            return ""
        return " collides with ".join(reached.nearest) if reached.nearest[0] else "out of the arm's reach"


def _arm(side: Side) -> slice:
    return slice(ARM_DOF * SIDES.index(side), ARM_DOF * (SIDES.index(side) + 1))
