"""One approach led by the field alone: no path is planned, there is no physics, drives and sight are perfect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.control.approach import ApproachLimits, FieldGuide, approach
from preshape.control.body import Body
from preshape.control.distances import Boxes
from preshape.control.failure import TaskFailed
from preshape.control.field import FieldOptions
from preshape.control.link_boxes import hand_nodes
from preshape.control.sight import Sight
from preshape.hal.layout import LAYOUT
from preshape.hal.state import RobotState
from preshape.hal.world import Image, OrientedBox, PoseSample
from preshape.planner.work_object import box_object
from preshape.tools.random_approach import RandomApproach, least_gap

PERIOD_S = 0.004


@dataclass(frozen=True, slots=True)
class FieldFlight:
    """How an approach ended (reached, stalled, timed out), after how long, s, and the hand's least gap on the way, m.

    The gap is the Euclidean one from the bounding boxes of the hand to box, posts, table and column, in every tick,
    whatever the field measures; negative when something was touched.
    """

    end: str
    seconds: float
    least_gap_m: float


class _PerfectSight:
    """`Perception` that sees box and posts as they are, and black images."""

    def __init__(self, made: RandomApproach) -> None:
        self._made = made

    def object_pose(self, now_ns: int) -> PoseSample:
        """Return the pose now."""
        return PoseSample(now_ns, self._made.X_world_box)

    def obstacles(self, now_ns: int) -> tuple[OrientedBox, ...]:
        """Return the posts."""
        return self._made.posts

    def image(self, now_ns: int) -> Image:
        """Return a black image of the cell's camera."""
        camera = self._made.cell.camera
        return Image(now_ns, np.zeros((camera.height, camera.width), np.uint8), camera)


def fly(made: RandomApproach, options: FieldOptions, limits: ApproachLimits | None = None) -> FieldFlight:
    """Let the field lead the hand from its start to its goal, through IK and smoothing."""
    body = Body(made.cell, PERIOD_S)
    sight = Sight(_PerfectSight(made), body)
    guide = FieldGuide(body, sight, made.box, box_object(made.box), options)
    motion = approach(guide, body, sight, "right", made.X_box_palm, made.preshape, limits=limits)
    things, nodes = Boxes.of(made.things), hand_nodes("right")
    position, velocity, no_torque = made.position.copy(), np.zeros(LAYOUT.dof), np.zeros(LAYOUT.dof)
    body.follow(position, velocity)
    end, least, tick = "reached", np.inf, 0
    while True:
        now_ns = round(tick * PERIOD_S * 1e9)
        body.update(now_ns, RobotState(tick, position, velocity, no_torque, np.full(LAYOUT.dof, now_ns)))
        sight.update(now_ns)
        poses = body.links.poses
        hand = Boxes(poses.p_box[nodes], poses.R_box[nodes], body.links.half[nodes])
        least = min(least, least_gap(hand, things))
        try:
            next(motion)
        except StopIteration:
            break
        except TaskFailed as failed:
            end = failed.kind
            break
        asked = body.setpoint().position
        velocity = (asked - position) / PERIOD_S
        position = asked.copy()
        tick += 1
    return FieldFlight(end, tick * PERIOD_S, least)
