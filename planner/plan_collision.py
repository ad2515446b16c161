"""Whether an option keeps arms and hands apart from everything: the coarse shapes of both arms, one place at a time."""

from __future__ import annotations

from preshape.hal.layout import SIDES, Side
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

    def between(self, hand: Hand, option: GraspOption, poses: tuple[ArmPose, ...], other: GraspOption | None) -> str:
        """Return what an option collides with, an empty text if nothing; `other` is what the other hand holds."""
        for pose in poses:
            if pose.place == "here" and self.scene.held is None:
                return self._collision(SIDE_OF[hand], option, pose, None)
            if pose.place == "handed over" and other is not None:
                return self._collision(SIDE_OF[hand], option, pose, other)
        return ""

    def _collision(self, side: Side, option: GraspOption, pose: ArmPose, other: GraspOption | None) -> str:
        scene, X_object = self.scene, pose.X_world_object
        q_arms = scene.q_arms.copy()
        q_hands: dict[Side, Matrix] = {**scene.q_hands, side: option.q_hand}
        obstacles, held, exempt = scene.obstacles, None, [(f"{side}_hand", part.name) for part in scene.target.parts]
        if other is None:
            obstacles = (*obstacles, *scene.target.boxes(X_object))
        else:
            q_hands[other.side] = other.q_hand
            found = self._arm(other, X_object)
            if found is None:
                return f"the {other.side} arm does not reach the place"
            q_arms[_arm(other.side)] = found
            X_palm_part = inverse(other.X_object_palm) @ other.part.X_object_part
            held, exempt = HeldBox(other.side, X_palm_part, other.part.half), [(f"{side}_hand", "held")]
        model = ArmCollision(scene.cell, q_hands, held, obstacles, exempt)
        reached = reach(side, scene.cell.X_world_base[side], pose.X_world_palm, model, q_arms, _QUERY)
        if reached.status is ReachStatus.REACHABLE:
            return ""
        return " collides with ".join(reached.nearest) if reached.nearest[0] else "out of the arm's reach"

    def _arm(self, option: GraspOption, X_world_object: Matrix) -> Matrix | None:
        side = option.side
        found = posture(side, self.scene.cell.X_world_base[side], X_world_object @ option.X_object_palm)
        return found.q if found.status is ReachStatus.REACHABLE else None


def _arm(side: Side) -> slice:
    return slice(7 * SIDES.index(side), 7 * SIDES.index(side) + 7)
