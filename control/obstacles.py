"""Everything the hands may meet, as one array of boxes grouped into bodies.

The robot's own 52 boxes come first: bodies `right_hand`, `left_hand`, `right_arm`, `left_arm`. Further bodies
are the parts of the paper box, the table, obstacles. A hand sees every body but itself; of its own arm it
sees the links up to the elbow only, the rest moves with it (self-collision is the IK's matter).
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from preshape.control.link_boxes import ARM_LINKS, NODE_COUNT, LinkBoxes, arm_nodes, hand_nodes
from preshape.hal.layout import SIDES, Side
from preshape.hal.transform import Matrix
from preshape.hal.world import OrientedBox


class Kind(StrEnum):
    """What a body is to the contact policy."""

    OBJECT = "object"
    """The paper box's shell, or any part of the object that is not to be opened."""
    OPENING = "opening"
    """The face that opens, once it is known."""
    ROBOT = "robot"
    """The other hand and the arms."""
    ENVIRONMENT = "environment"
    """Table, column, obstacles."""


ROBOT_BODIES = ("right_hand", "left_hand", "right_arm", "left_arm")
MAX_BODIES = 24
MAX_BOXES = NODE_COUNT + 60
_OWN_ARM_SEEN = 4


class Obstacles:
    """Boxes in the world (m) as preallocated arrays; bodies are contiguous runs of boxes.

    `p` (n, 3), `R` (n, 3, 3), `half` (n, 3), `radius` (n,) of the bounding sphere; `first`, `last` (bodies,)
    delimit each body's boxes (empty = absent); `seen` (2, n) tells which boxes each hand avoids.
    """

    def __init__(self, links: LinkBoxes) -> None:
        """Start with the robot's boxes alone; `track` fills in their poses."""
        self.p = np.zeros((MAX_BOXES, 3))
        self.R = np.tile(np.eye(3), (MAX_BOXES, 1, 1))
        self.half = np.zeros((MAX_BOXES, 3))
        self.radius = np.zeros(MAX_BOXES)
        self.first = np.zeros(MAX_BODIES, dtype=np.int64)
        self.last = np.zeros(MAX_BODIES, dtype=np.int64)
        self.seen = np.ones((2, MAX_BOXES), dtype=np.bool_)
        self.names: list[str] = list(ROBOT_BODIES)
        self.kinds: list[Kind] = [Kind.ROBOT] * len(ROBOT_BODIES)
        self._local: dict[str, tuple[Matrix, Matrix]] = {}
        self._links = links
        self._used = NODE_COUNT
        for body, nodes in enumerate((*map(hand_nodes, SIDES), *map(arm_nodes, SIDES))):
            self.first[body], self.last[body] = nodes.start, nodes.stop
        for number, side in enumerate(SIDES):
            self.seen[number, hand_nodes(side)] = False
            arm = arm_nodes(side)
            self.seen[number, arm.start + _OWN_ARM_SEEN : arm.start + ARM_LINKS] = False
        self.half[:NODE_COUNT] = links.half
        self.radius[:NODE_COUNT] = np.linalg.norm(links.half, axis=1)

    @property
    def bodies(self) -> int:
        """Number of bodies known."""
        return len(self.names)

    def index(self, name: str) -> int:
        """Return a body's index; `KeyError` names the valid ones."""
        if name not in self.names:
            raise KeyError(f"body {name!r} is none of {', '.join(self.names)}")
        return self.names.index(name)

    def track(self) -> None:
        """Copy the robot's box poses as of its last `update`."""
        self.p[:NODE_COUNT] = self._links.poses.p_box
        self.R[:NODE_COUNT] = self._links.poses.R_box

    def add(self, name: str, kind: Kind, boxes: Sequence[OrientedBox]) -> int:
        """Add a body and return its index; the boxes' poses are kept as its local ones (see `move`).

        `ValueError` when the name is taken or there is no room.
        """
        if name in self.names:
            raise ValueError(f"body {name!r} exists already")
        first, last = self._used, self._used + len(boxes)
        if last > MAX_BOXES or self.bodies == MAX_BODIES:
            raise ValueError(f"body {name!r}: box {last}, body {self.bodies + 1}; room is {MAX_BOXES}, {MAX_BODIES}")
        body = self.bodies
        self.names.append(name)
        self.kinds.append(kind)
        self.first[body], self.last[body], self._used = first, last, last
        X = np.array([box.X_world_box for box in boxes]).reshape(-1, 4, 4)
        self._local[name] = X[:, :3, 3].copy(), X[:, :3, :3].copy()
        self.half[first:last] = np.array([box.half for box in boxes]).reshape(-1, 3)
        self.radius[first:last] = np.linalg.norm(self.half[first:last], axis=1)
        self.p[first:last], self.R[first:last] = self._local[name]
        return body

    def move(self, name: str, X_world_body: Matrix) -> None:
        """Place a body whose boxes were given in its own frame."""
        body = self.index(name)
        p_local, R_local = self._local[name]
        run = slice(self.first[body], self.last[body])
        R = X_world_body[:3, :3]
        self.p[run] = p_local @ R.T + X_world_body[:3, 3]
        self.R[run] = R @ R_local

    def hide(self, side: Side, name: str, hidden: bool = True) -> None:
        """Let one hand ignore (or see again) a whole body, as an absent or carried one."""
        body = self.index(name)
        self.seen[SIDES.index(side), self.first[body] : self.last[body]] = not hidden
