"""The last word on obstacles: whatever leads the arms, they brake before a link, a hand or the held box touches one.

Paths and fields keep their distance by themselves; this holds for every motion, also for one that was planned before
the obstacle appeared.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.control.body import Body
from preshape.control.distances import Boxes, PairDistances, pair_distances
from preshape.control.link_boxes import NODE_COUNT, NODES, PARTS, LinkBoxes, NodePoses, arm_nodes, hand_nodes
from preshape.control.sight import Sight
from preshape.hal import panda_arm, sah_hand
from preshape.hal.compiled import compiled
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, inverse
from preshape.hal.world import NominalBox
from preshape.planner.capsule_distance import segment_box_distance

MARGIN_M = 0.010
"""Distance from an obstacle that no motion may bring to less, m."""
ROOM_M = 0.020
"""Distance at which what has stood before an obstacle may go on, m."""
NEARER_M = 1e-5
"""What comes nearer by less than this while it brakes may go on, m: it stands, or moves along the obstacle."""
REACTION_S = 0.010
"""Time until braking begins, s."""
PATIENCE_S = 2.0
"""How long the arms stand before an obstacle until the motion that brought them there is given up, s."""
_ACCELERATION = 0.9 * LAYOUT.acceleration
_HELD = NODE_COUNT


def _round_nodes() -> tuple[NDArray[np.int64], Matrix, Matrix]:
    """Return the nodes that are capsules, half their segments in their boxes' frames (n, 3), and their radii, m."""
    nodes: list[int] = []
    half: list[list[float]] = []
    radii: list[float] = []
    for side in SIDES:
        for node, link in zip(range(NODE_COUNT)[arm_nodes(side)], panda_arm.CAPSULES, strict=True):
            nodes.append(node)
            half.append([0.0, 0.0, float(np.linalg.norm(np.subtract(link.end, link.start))) / 2])
            radii.append(link.radius)
        for node, part in zip(range(NODE_COUNT)[hand_nodes(side)], PARTS, strict=True):
            shape = sah_hand.PARTS[part][0]
            if shape.kind == "capsule":
                radius, start, end = shape.size
                nodes.append(node)
                half.append([abs(end - start) / 2, 0.0, 0.0])
                radii.append(radius)
    return np.array(nodes, dtype=np.int64), np.array(half), np.array(radii)


_ROUND, _HALF_SEGMENTS, _RADII = _round_nodes()


@compiled
def _round_distances(
    nodes: NDArray[np.int64], half_segments: Matrix, radii: Matrix, poses: NodePoses,
    p_obstacles: Matrix, R_obstacles: Matrix, half: Matrix, out: Matrix,
) -> None:  # fmt: skip
    """Write the distances of what is a capsule, as the planner knows it, into out (nodes, obstacles), m."""
    X = np.eye(4)
    for k in range(len(half)):
        X[:3, :3], X[:3, 3] = R_obstacles[k], p_obstacles[k]
        for number in range(len(nodes)):
            node = nodes[number]
            p, reach = poses.p_box[node], poses.R_box[node] @ half_segments[number]
            out[node, k] = segment_box_distance(p - reach, p + reach, X, half[k]) - radii[number]


def stopping_position(position: Vector, velocity: Vector) -> Vector:
    """Return where joints at a velocity come to rest, rad: q + sign(v) (v^2 / 2A + |v| (A / 2J + t_r))."""
    way = velocity**2 / (2.0 * _ACCELERATION) + np.abs(velocity) * (_ACCELERATION / (2.0 * LAYOUT.jerk) + REACTION_S)
    return position + np.sign(velocity) * way


class ObstacleGuard:
    """Watches the commands of both arms and hands against every obstacle that is seen; `look` once a tick."""

    def __init__(self, body: Body, sight: Sight, box: NominalBox) -> None:
        """Watch a body; with nothing seen it costs nothing."""
        self._body, self._sight, self._half = body, sight, box.size / 2
        self._links = LinkBoxes(body.cell.X_world_base)
        self._boxes = Boxes(
            np.zeros((NODE_COUNT + 1, 3)),
            np.tile(np.eye(3), (NODE_COUNT + 1, 1, 1)),
            np.vstack([self._links.half, self._half]),
        )
        self._pairs = self._box_pairs = np.empty((0, 2), dtype=np.int64)
        self._of_boxes: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._out = PairDistances.empty(0)
        self._waiting: NDArray[np.bool_] = np.empty(0, dtype=np.bool_)
        self.stood_s = 0.0
        self.reason = ""

    @property
    def blocked(self) -> bool:
        """Whether the arms have to stand in this tick."""
        return bool(self.reason)

    def look(self) -> None:
        """Decide for this tick whether the arms may go on, from where they would come to rest if they braked now."""
        seen = self._sight.obstacles
        if not seen:
            self.stood_s, self.reason = 0.0, ""
            return
        obstacles = Boxes.of(seen)
        position, velocity = self._body.commanded
        now = self.distances(position, obstacles)
        stopped = self.distances(stopping_position(position, velocity), obstacles)
        coming = (stopped < MARGIN_M) & (stopped < now - NEARER_M)
        if self.blocked and len(self._waiting) == len(now):
            # Where it stands, it goes on only when there is room again.
            coming |= self._waiting & (now < ROOM_M)
        if not coming.any():
            self.stood_s, self.reason = 0.0, ""
            return
        self._waiting = coming
        nearest = int(np.argmin(np.where(coming, stopped, np.inf)))
        link, obstacle = self._pairs[nearest]
        name = "held box" if link == _HELD else NODES[link].replace("_", " ", 1)
        self.reason = f"the {name} {max(0.0, 1e3 * float(now[nearest])):.0f} mm from {seen[obstacle].name}"
        self.stood_s += self._body.period_s

    def give_up(self) -> str:
        """Return what stands in the way, and let the next motion lead away from it."""
        reason, self.reason, self.stood_s = self.reason, "", 0.0
        return reason

    def distances(self, position: Vector, obstacles: Boxes) -> Matrix:
        """Return the distance of each pair (m,), m, with the joints at a position and the held box in its hand.

        Palms and held box are boxes; arms and fingers are the planner's capsules, so that a path it has found is free.
        """
        boxes, side = self._boxes, self._sight.held_by
        poses = self._links.update(position)
        boxes.p[:NODE_COUNT], boxes.R[:NODE_COUNT] = poses.p_box, poses.R_box
        count = NODE_COUNT
        if side is not None:
            X = self._links.palm(side) @ inverse(self._body.palm(side)) @ self._sight.X_world_box
            boxes.p[_HELD], boxes.R[_HELD], count = X[:3, 3], X[:3, :3], NODE_COUNT + 1
        if len(self._pairs) != count * len(obstacles.p):
            self._pairs = np.array([(i, k) for i in range(count) for k in range(len(obstacles.p))], dtype=np.int64)
            self._of_boxes = np.flatnonzero(~np.isin(self._pairs[:, 0], _ROUND))
            self._box_pairs = self._pairs[self._of_boxes]
            self._out = PairDistances.empty(len(self._box_pairs))
        pair_distances("l2", boxes, obstacles, self._box_pairs, self._out)
        distance = np.empty(len(self._pairs))
        distance[self._of_boxes] = self._out.distance
        _round_distances(
            _ROUND, _HALF_SEGMENTS, _RADII, poses, obstacles.p, obstacles.R, obstacles.h,
            distance.reshape(count, len(obstacles.p)),
        )  # fmt: skip
        return distance
