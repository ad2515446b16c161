"""Which option a grasp takes: reachable in all later tasks > closure margin > clearance > distance to the hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from preshape.hal.transform import log_so3
from preshape.hal.world import Face
from preshape.planner.availability import ArmPose, Assessment, Availability
from preshape.planner.component import Component
from preshape.planner.grasp_option import GraspOption
from preshape.planner.hand_clearance import hand_clearance
from preshape.planner.plan_collision import PlanCollision
from preshape.planner.procedure import PAPER_PROCEDURE, Block, Hand, Place, Procedure

PALM_LEVER = 0.15
"""Distance that a turn of the palm by a radian counts for, m."""

EPSILON_STEP = 0.01
"""Closure margins that differ by less are as good as each other."""

CLEARANCE_STEP_M = 0.002
"""Clearances that differ by less are as good as each other, m."""


@dataclass(frozen=True, slots=True, eq=False)
class RankedOption:
    """An option that can be used in all tasks of its block, with what it is ranked by.

    Attributes:
        option: component, thumb, preshaping box and preshape.
        faces: those faces that may carry the opening for which the option serves all tasks.
        poses: where the arm holds the object, one pose for each place the tasks ask for.
        clearance_m: least distance of the hand at its preshape from the object and from bodies around, m.
        distance_m: how far the palm is from its grasp now, a turn counting `PALM_LEVER` a radian, m.
        hidden_share: share of the search area that the hand hides from the camera.
    """

    option: GraspOption
    faces: tuple[Face, ...]
    poses: tuple[ArmPose, ...]
    clearance_m: float
    distance_m: float
    hidden_share: float

    @property
    def rank(self) -> tuple[float, ...]:
        """Return what options are sorted by, the least first.

        Reachable in all later tasks, wherever the opening is > closure margin > clearance > distance to the hand.
        """
        return (
            -len(self.faces),
            -np.floor(self.option.closure.epsilon / EPSILON_STEP),
            -np.floor(self.clearance_m / CLEARANCE_STEP_M),
            self.distance_m,
        )


class OptionChooser:
    """Picks each grasp's best option that is also free of collisions with what has been picked before."""

    def __init__(self, available: Availability) -> None:
        """Start with nothing picked."""
        self._available, self._collision = available, PlanCollision(available.scene)
        self._procedure = PAPER_PROCEDURE
        self._picked: dict[Block, RankedOption] = {}
        self._known: dict[tuple[Block, str], RankedOption | None] = {}

    def begin(self, procedure: Procedure) -> None:
        """Forget what was picked; the next choices are for this procedure."""
        if procedure != self._procedure:
            self._procedure, self._known = procedure, {}
        self._picked = {}

    def choose(self, block: Block, candidates: tuple[Component, ...]) -> Component:
        """Return the component of the best option; options that collide are withdrawn, and planning starts anew."""
        hand = cast(Hand, block.resource)
        for ranked in self._usable(block, candidates):
            others = [picked.option for b, picked in self._picked.items() if b.meets(block)]
            collision = self._collision.between(hand, ranked.option, ranked.poses, others)
            if not collision:
                self._picked[block] = ranked
                return ranked.option.component
            self._available.withdraw(hand, ranked.option, collision)
        # A component may serve each task with another thumb, and none of its options all of them.
        for component in candidates:
            for option in self._available.options(hand, component):
                self._available.withdraw(hand, option, "serves no place of all tasks")
        return candidates[0]

    def ranked(self, block: Block, candidates: tuple[Component, ...]) -> tuple[RankedOption, ...]:
        """Return what was picked for a grasp, then its other options in order."""
        picked = self._picked[block]
        return picked, *(ranked for ranked in self._usable(block, candidates) if ranked is not picked)

    def _usable(self, block: Block, candidates: tuple[Component, ...]) -> list[RankedOption]:
        hand = cast(Hand, block.resource)
        found: list[RankedOption] = []
        for component in candidates:
            for option in self._available.options(hand, component):
                key = (block, str(option))
                if key not in self._known:
                    self._known[key] = self._assessed(block, hand, option)
                ranked = self._known[key]
                if ranked is not None and not self._available.is_withdrawn(hand, option):
                    found.append(ranked)
        return sorted(found, key=lambda ranked: ranked.rank)

    def _assessed(self, block: Block, hand: Hand, option: GraspOption) -> RankedOption | None:
        tasks = self._procedure.tasks[block.first - 1 : block.last]
        places: dict[Place, Assessment] = {}
        for task in tasks:
            places[task.place] = self._available.assess(hand, task.place, option)
            if places[task.place].refusal:
                return None
        carrying = self._available.scene.faces(self._available.part)
        faces: list[Face] = list(carrying)
        for assessment in places.values():
            if assessment.poses and None not in assessment.poses:
                faces = [face for face in faces if face in assessment.poses]
        if carrying and not faces:
            return None
        poses = tuple(pose for a in places.values() for f, pose in a.poses.items() if f is None or f in faces)
        hidden = max(a.hidden_share for a in places.values())
        clearance, distance = self._clearance(option, "here" in places), self._distance(hand, option, poses)
        return RankedOption(option, tuple(faces), poses, clearance, distance, hidden)

    def _clearance(self, option: GraspOption, at_rest: bool) -> float:
        scene = self._available.scene
        X_object = scene.X_world_object
        bodies = (*scene.target.boxes(X_object), *(scene.bodies if at_rest else ()))
        return hand_clearance(option.side, X_object @ option.X_object_palm, option.q_hand, bodies)[0]

    def _distance(self, hand: Hand, option: GraspOption, poses: tuple[ArmPose, ...]) -> float:
        X_now = self._available.palm_now(hand)
        X_goal = poses[0].X_world_palm if poses else self._available.scene.X_world_object @ option.X_object_palm
        turn, way = log_so3(X_now[:3, :3].T @ X_goal[:3, :3]), X_goal[:3, 3] - X_now[:3, 3]
        return float(np.sqrt(way @ way) + PALM_LEVER * np.sqrt(turn @ turn))
