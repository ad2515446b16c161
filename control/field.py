"""The grouped vector field of the paper's section IV: who is pushed by what, and how fast it moves.

For every group B_i and body the reciprocal force is sum_j G_ij^T f_ij / m_i. The hand base takes the sum over
all groups, the joints only that of their own group; `FieldGains` says which of them count at the moment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from preshape.control.distances import NORMS, Norm
from preshape.control.field_kernel import Gains, Parts, Results, Rules, Work, World, field_kernel
from preshape.control.groups import GROUPS, MEMBERS, PART_GROUPS, PART_MEMBERS, TIES, Group, Ties
from preshape.control.link_boxes import LinkBoxes, hand_nodes
from preshape.control.obstacles import MAX_BODIES, MAX_BOXES, Obstacles
from preshape.control.potentials import FieldParameters, attraction, pose_error
from preshape.hal.layout import HAND_DOF, LAYOUT, SIDES, Side
from preshape.hal.transform import Matrix, cross

FieldMode = Literal["grouped", "summed"]
FIELD_MODES: tuple[FieldMode, FieldMode] = ("grouped", "summed")
"""`summed` is the usual vector field, the paper's baseline: every box counts by itself, no minimum per group."""

_LARGEST_GROUP = 12
_MAX_PAIRS = _LARGEST_GROUP * MAX_BOXES
_PARTS = Parts(
    group=PART_GROUPS.copy(),
    member=np.array([MEMBERS.index(member) for member in PART_MEMBERS]),
    palm=np.array([hand_nodes(side).start for side in SIDES]),
    first_joint=np.array([LAYOUT.hand(side).start for side in SIDES]),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldOptions:
    """The switches of the comparison: norm, ties and grouping."""

    norm: Norm = "l2"
    ties: Ties = "smooth"
    mode: FieldMode = "grouped"

    def __post_init__(self) -> None:
        for name, allowed in (("norm", NORMS), ("ties", TIES), ("mode", FIELD_MODES)):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name}: got {getattr(self, name)!r}, allowed are {', '.join(allowed)}")


class FieldGains:
    """Which group repels from which body, acting on what; arrays are written in place.

    base, joints (hand, member, body): gains in 0 .. 1 of the member's forces on the hand base and on its own
    joints; ignored (hand, member, body): left out of its group's minimum, as members that may touch are;
    reach (hand, group, body): range in m, 0 = the pair is not measured at all.
    """

    def __init__(self, parameters: FieldParameters) -> None:
        """Start with everything repelling, on base and joints, over the full range."""
        shape = (2, len(MEMBERS), MAX_BODIES)
        self.base, self.joints = np.ones(shape), np.ones(shape)
        self.ignored = np.zeros(shape, dtype=np.bool_)
        self.reach = np.full((2, len(GROUPS), MAX_BODIES), parameters.range_m)

    def arrays(self) -> Gains:
        """Return the arrays as the kernel takes them."""
        return Gains(self.base, self.joints, self.ignored, self.reach)


@dataclass(frozen=True, slots=True, eq=False)
class GroupReading:
    """Telemetry of one group.

    Signed distance to its nearest body (m, inf beyond the range), that body's name, the reciprocal point
    there (m) and the force on the group summed over bodies (N), in the world frame.
    """

    group: Group
    distance: float
    body: str
    point: Matrix
    force: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class HandGoal:
    """Where a hand shall go: palm pose in the world and its 13 joint angles (rad)."""

    X_world_palm: Matrix
    joints: Matrix


class HandError(NamedTuple):
    """How far a hand is off its goal: its base by a position (3,), m, and a turn (3,), rad; its joints (13,), rad."""

    position: Matrix
    turn: Matrix
    joints: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class HandMotion:
    """What the field asks of one hand.

    `twist` of the palm frame in the world: velocity of its origin (m/s), then angular velocity (rad/s);
    `joints`: 13 joint velocities (rad/s).
    """

    twist: Matrix
    joints: Matrix


class Field:
    """The field of both hands over one robot and its obstacles."""

    def __init__(
        self,
        links: LinkBoxes,
        obstacles: Obstacles,
        options: FieldOptions | None = None,
        parameters: FieldParameters | None = None,
    ) -> None:
        """Allocate everything an evaluation needs."""
        self.links, self.obstacles = links, obstacles
        self.options = options or FieldOptions()
        self.parameters = parameters or FieldParameters()
        self.gains = FieldGains(self.parameters)
        shape = (2, len(GROUPS), MAX_BODIES)
        self.results = Results(
            np.zeros((2, 6)), np.zeros((2, HAND_DOF)), np.zeros(2), np.full(shape, np.inf), np.zeros((*shape, 3)),
            np.zeros((*shape, 3)),
        )  # fmt: skip
        self._work = Work.empty(_MAX_PAIRS)
        o = obstacles
        self._world = World(o.p, o.R, o.half, o.radius, o.first, o.last, o.seen)
        options, p = self.options, self.parameters
        self._rules = Rules(
            options.norm == "l2", options.ties == "smooth", options.mode == "grouped", p.strength_n, p.tie_m
        )

    def evaluate(self) -> Results:
        """Evaluate the repulsion at the links' and obstacles' present poses; the arrays are overwritten next time."""
        self.obstacles.track()
        field_kernel(
            self._rules, self._world, self.gains.arrays(), self.links.tree, self.links.poses, _PARTS,
            self.obstacles.bodies, self._work, self.results,
        )  # fmt: skip
        return self.results

    def repulsion(self, side: Side) -> HandMotion:
        """Return the motion that the last evaluation's repulsion asks of one hand: mobility times force."""
        hand, p = SIDES.index(side), self.parameters
        wrench = self.results.wrench[hand]
        twist = np.concatenate([p.base_mobility * wrench[:3], p.turn_mobility * wrench[3:]])
        return HandMotion(twist, p.joint_mobility * self.results.torque[hand])

    def attraction(self, off: HandError) -> HandMotion:
        """Return the motion that the attraction asks of a hand that is off its goal."""
        p = self.parameters
        force = attraction(off.position, p.pull_n, p.near_m)
        torque = attraction(off.turn, p.pull_nm, p.near_rad)
        joint_torque = attraction(off.joints, p.joint_pull_nm, p.joint_near_rad)
        twist = np.concatenate([p.base_mobility * force, p.turn_mobility * torque])
        return HandMotion(twist, p.joint_mobility * joint_torque)

    def motion(self, side: Side, off: HandError, feed_forward: ArrayLike | None = None) -> HandMotion:
        """Return attraction plus repulsion of the last evaluation, plus a twist (6,) of the goal's frame at the palm.

        The feed-forward is what a moving box asks (`carried_twist`): the field then lives in the box's frame.
        """
        pull, push = self.attraction(off), self.repulsion(side)
        twist = pull.twist + push.twist
        if feed_forward is not None:
            twist = twist + np.asarray(feed_forward, dtype=np.float64)
        return HandMotion(twist, pull.joints + push.joints)

    def readings(self, side: Side) -> tuple[GroupReading, ...]:
        """Return the telemetry of the last evaluation, one value a group; the force is summed over bodies."""
        hand, bodies = SIDES.index(side), self.obstacles.bodies
        readings: list[GroupReading] = []
        for number, group in enumerate(GROUPS):
            distances = self.results.distance[hand, number, :bodies]
            nearest = int(np.argmin(distances))
            readings.append(
                GroupReading(
                    group,
                    float(distances[nearest]),
                    self.obstacles.names[nearest] if np.isfinite(distances[nearest]) else "",
                    self.results.point[hand, number, nearest].copy(),
                    self.results.force[hand, number, :bodies].sum(axis=0),
                )
            )
        return tuple(readings)


def hand_error(goal: HandGoal, X_world_palm: Matrix, joints: Matrix) -> HandError:
    """Return how far a hand at a palm pose and 13 joint angles (rad) is off a goal, in the world frame.

    Goal minus hand: p_goal - p, R log(R^T R_goal), q_goal - q.
    """
    return HandError(*pose_error(goal.X_world_palm, X_world_palm), goal.joints - joints)


def carried_twist(twist: ArrayLike, p_from: ArrayLike, p_to: ArrayLike) -> Matrix:
    """Return the twist at p_to of a body whose twist (velocity, angular velocity) at p_from is given: v + w x r."""
    t = np.asarray(twist, dtype=np.float64)
    r = np.asarray(p_to, dtype=np.float64) - np.asarray(p_from, dtype=np.float64)
    return np.concatenate([t[:3] + cross(t[3:], r), t[3:]])
