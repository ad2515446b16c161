"""The compiled heart of the grouped field: distances, ties, potentials and G^T f for both hands in one call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from preshape.control.distance_l1 import WORK_L1, pair_l1
from preshape.control.distance_l2 import WORK_L2, pair_l2
from preshape.control.distance_soft import WORK_SOFT, pair_soft
from preshape.control.distances import relative_box, rotated
from preshape.control.groups import SOFT_WINDOW, tie_weights
from preshape.control.link_boxes import NodePoses, Tree
from preshape.control.potentials import repulsion
from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix

Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]


class World(NamedTuple):
    """Boxes of all bodies as in `Obstacles`: p, R, half, radius, runs first .. last, seen (2, n)."""

    p: Matrix
    R: Matrix
    half: Matrix
    radius: Matrix
    first: Indices
    last: Indices
    seen: Flags


class Gains(NamedTuple):
    """What acts on what.

    Per hand, member and body (2, 5, B): gains on base and joints in 0 .. 1 and who is left out of its
    group's minimum (`ignored`); per hand, group and body (2, 3, B): the range `reach` in m, 0 = not measured.
    """

    base: Matrix
    joints: Matrix
    ignored: Flags
    reach: Matrix


class Results(NamedTuple):
    """Outputs, in the world frame.

    Per hand: wrench (2, 6), force then torque about the palm's origin, joint torque (2, 13), energy (2,);
    per hand, group and body (2, 3, B, ...): distance, reciprocal point and force.
    """

    wrench: Matrix
    torque: Matrix
    energy: Matrix
    distance: Matrix
    point: Matrix
    force: Matrix


class Work(NamedTuple):
    """Scratch: candidate pairs of one (group, body) and the small arrays of one pair."""

    distance: Matrix
    weight: Matrix
    point: Matrix
    gradient: Matrix
    part: Indices
    vectors: Matrix
    R_rel: Matrix
    l1: Matrix
    l2: Matrix
    soft: Matrix

    @staticmethod
    def empty(pairs: int) -> Work:
        """Return scratch for so many pairs of one (group, body)."""
        return Work(
            np.zeros(pairs), np.zeros(pairs), np.zeros((pairs, 3)), np.zeros((pairs, 3)), np.zeros(pairs, np.int64),
            np.zeros((8, 3)), np.zeros((3, 3)), np.zeros(WORK_L1), np.zeros(WORK_L2), np.zeros(WORK_SOFT),
        )  # fmt: skip


class Parts(NamedTuple):
    """Group and member of each part (18,), palm node and first joint of each hand (2,)."""

    group: Indices
    member: Indices
    palm: Indices
    first_joint: Indices


class Rules(NamedTuple):
    """Norm (L2 or L1), ties (smooth or hard), grouping (or the summed baseline), strength (N) and epsilon (m)."""

    euclidean: bool
    smooth: bool
    grouped: bool
    strength: float
    epsilon: float


@compiled
def _too_far(world: World, box: int, x: Matrix, node: int, cutoff: float) -> bool:
    """Tell by the link's bounding sphere whether a pair is surely farther apart than the cutoff."""
    reach = cutoff + world.radius[node]
    r0, r1, r2 = x[0] - world.p[box, 0], x[1] - world.p[box, 1], x[2] - world.p[box, 2]
    square = r0 * r0 + r1 * r1 + r2 * r2
    if square > (reach + world.radius[box]) ** 2:
        return True
    square = 0.0
    for k in range(3):
        along = abs(world.R[box, 0, k] * r0 + world.R[box, 1, k] * r1 + world.R[box, 2, k] * r2) - world.half[box, k]
        if along > 0.0:
            square += along * along
    return square > reach * reach


@compiled
def _measure(
    rules: Rules, world: World, poses: NodePoses, node: int, box: int, cutoff: float, n: int, work: Work
) -> float:
    """Write candidate n: distance, point on the link and gradient in the world; return the exact distance."""
    y, a, o, d = work.vectors[0], work.vectors[1], work.vectors[2], work.vectors[3]
    relative_box(poses.p_box[node], poses.R_box[node], world.p[box], world.R[box], y, work.R_rel)
    h, H = world.half[node], world.half[box]
    if rules.euclidean:
        exact = pair_l2(y, work.R_rel, h, H, cutoff, a, o, d, work.l2)
    else:
        exact = pair_l1(y, work.R_rel, h, H, a, o, d, work.l1)
    if exact > cutoff:
        return exact
    value = exact
    if rules.smooth and exact > 0.0:
        value = pair_soft(rules.euclidean, y, work.R_rel, h, H, a, d, work.soft)
    work.distance[n] = value
    rotated(world.R[box], a, work.point[n])
    rotated(world.R[box], d, work.gradient[n])
    for k in range(3):
        work.point[n, k] += world.p[box, k]
    return exact


@compiled
def _apply(
    tree: Tree, poses: NodePoses, palm: int, first_joint: int, node: int, x: Matrix, f: Matrix,
    base: float, joints: float, wrench: Matrix, torque: Matrix,
) -> None:  # fmt: skip
    """Add G^T f of a force f (N) at x (m) on a node to the palm's wrench and to the joints between node and palm."""
    if base > 0.0:
        r0, r1, r2 = x[0] - poses.p[palm, 0], x[1] - poses.p[palm, 1], x[2] - poses.p[palm, 2]
        for k in range(3):
            wrench[k] += base * f[k]
        wrench[3] += base * (r1 * f[2] - r2 * f[1])
        wrench[4] += base * (r2 * f[0] - r0 * f[2])
        wrench[5] += base * (r0 * f[1] - r1 * f[0])
    if joints > 0.0:
        while node != palm:
            r0, r1, r2 = x[0] - poses.p[node, 0], x[1] - poses.p[node, 1], x[2] - poses.p[node, 2]
            moment = (
                poses.R[node, 0, 2] * (r1 * f[2] - r2 * f[1])
                + poses.R[node, 1, 2] * (r2 * f[0] - r0 * f[2])
                + poses.R[node, 2, 2] * (r0 * f[1] - r1 * f[0])
            )
            torque[tree.drive[node] - first_joint] += joints * tree.sign[node] * moment
            node = tree.parent[node]


@compiled
def _collect(
    rules: Rules, world: World, gains: Gains, poses: NodePoses, parts: Parts,
    hand: int, group: int, body: int, work: Work,
) -> tuple[int, float]:  # fmt: skip
    """Measure the pairs of one (group, body) that can matter; return their number and the smallest exact distance."""
    window = rules.epsilon * (SOFT_WINDOW if rules.smooth else 1.0)
    reach = gains.reach[hand, group, body]
    limit = reach + (3.0 * rules.epsilon if rules.smooth else 0.0)
    count, nearest = 0, np.inf
    for part in range(parts.group.shape[0]):
        if parts.group[part] != group or gains.ignored[hand, parts.member[part], body]:
            continue
        node = parts.palm[hand] + part
        for box in range(world.first[body], world.last[body]):
            cutoff = min(limit, nearest + window) if rules.grouped else reach
            if not world.seen[hand, box] or _too_far(world, box, poses.p_box[node], node, cutoff):
                continue
            exact = _measure(rules, world, poses, node, box, cutoff, count, work)
            if exact <= cutoff:
                work.part[count] = part
                nearest = min(nearest, exact)
                count += 1
    return count, nearest


@compiled
def _one_body(
    rules: Rules, world: World, gains: Gains, tree: Tree, poses: NodePoses, parts: Parts,
    hand: int, group: int, body: int, count: int, work: Work, results: Results,
) -> None:  # fmt: skip
    """Turn the measured pairs of one (group, body) into forces: sum_j G_j^T f_j w_j."""
    reach = gains.reach[hand, group, body]
    f = work.vectors[4]
    palm, joint_force = parts.palm[hand], 0.0
    if rules.grouped:
        shared = tie_weights(rules.smooth, work.distance, count, rules.epsilon, work.weight)
        energy, joint_force = repulsion(shared, reach, rules.strength)
        if rules.smooth:
            results.energy[hand] += energy
    for j in range(count):
        weight = work.weight[j] if rules.grouped else 1.0
        if weight == 0.0:
            continue
        force = joint_force
        if not (rules.grouped and rules.smooth):
            energy, force = repulsion(work.distance[j], reach, rules.strength)
            results.energy[hand] += weight * energy
        if force == 0.0:
            continue
        for k in range(3):
            f[k] = weight * force * work.gradient[j, k]
            results.force[hand, group, body, k] += f[k]
            results.point[hand, group, body, k] += work.point[j, k] * (weight if rules.grouped else 1.0 / count)
        member = parts.member[work.part[j]]
        _apply(
            tree, poses, palm, parts.first_joint[hand], palm + work.part[j], work.point[j], f,
            float(gains.base[hand, member, body]), float(gains.joints[hand, member, body]),
            results.wrench[hand], results.torque[hand],
        )  # fmt: skip


@compiled
def field_kernel(
    rules: Rules,
    world: World,
    gains: Gains,
    tree: Tree,
    poses: NodePoses,
    parts: Parts,
    bodies: int,
    work: Work,
    results: Results,
) -> None:
    """Write the field of both hands: minimum per (group, body), then the sum over bodies and, for the base, groups.

    `energy` is the potential whose negative gradient the forces are when all gains are 1. A distance beyond
    the range is inf, its point and force zero.
    """
    results.wrench[:] = 0.0
    results.torque[:] = 0.0
    results.energy[:] = 0.0
    results.distance[:] = np.inf
    results.point[:] = 0.0
    results.force[:] = 0.0
    for hand in range(2):
        for body in range(bodies):
            if world.first[body] == world.last[body] or body == hand:
                continue
            for group in range(3):
                if gains.reach[hand, group, body] <= 0.0:
                    continue
                count, nearest = _collect(rules, world, gains, poses, parts, hand, group, body, work)
                if count > 0:
                    results.distance[hand, group, body] = nearest
                    _one_body(rules, world, gains, tree, poses, parts, hand, group, body, count, work, results)
