"""Where a closed grip touches the box: its stages played against the box's surface, without physics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from preshape.control.grip import Grip
from preshape.hal.description import part_box
from preshape.hal.layout import HAND_DOF, Side, finger_slice
from preshape.hal.sah_hand import ACTUATED, FINGERS, PARTS
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.planner.hand_kinematics import PART_COUNT, hand_kinematics, part_frames, point_jacobian

TOUCHING_M = 0.003
"""Points of a closed finger this close to the surface bear load as well, m: the box turns by 2 deg to meet them.

Seen so in physics: under the brace grip the middle finger's proximal link comes to touch the box's edge.
"""
INSIDE_M = 0.0002
"""A finger that is brought this deep into the box before it closes is wedged there, m, and crushes it."""
_SAMPLES = 41
_STEP = 0.01
_NAMES = tuple(PARTS)


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """Contacts of one hand on an object, in one frame: the box's, or the preshaping box's of a planned grip.

    `points` (n, 3), m; `normals` (n, 3) into the object; `jacobians` (n, 3, 13), velocity of the finger at the point
    over joint speeds, m/rad; `parts`: which part of the hand touches there; `angles` (13): the closed hand, rad.
    """

    points: Matrix
    normals: Matrix
    jacobians: Matrix
    parts: tuple[str, ...]
    angles: Vector


class _Near(NamedTuple):
    clearance: Matrix
    part: Matrix
    sample: Matrix
    surface: Matrix


def _axis_points(side: Side, finger: str) -> list[tuple[int, float, Matrix]]:
    """Return (part, radius, points (n, 3) along the capsule's axis in the part's frame) of a finger's capsules."""
    rows: list[tuple[int, float, Matrix]] = []
    for link in ("prox", "mid", "dist"):
        name = f"{finger}_{link}"
        center, half = part_box(side, name)
        radius = float(half[1])
        x = center[0] + np.linspace(-1.0, 1.0, _SAMPLES) * (half[0] - radius)
        rows.append(
            (_NAMES.index(name), radius, np.column_stack([x, np.full_like(x, center[1]), np.full_like(x, 0.0)]))
        )
    return rows


class ClosedGrip:
    """A grip's fingers moved to the box's surface one after another, as the grasp law moves them."""

    def __init__(self, grip: Grip, size: Matrix) -> None:
        """Take a grip of a box of outer size (3,), m; `ValueError` names a joint that finds nothing or is inside."""
        self._grip, self._half = grip, np.asarray(size, float) / 2
        self._kinematics = hand_kinematics(grip.side)
        self._axes = {finger: _axis_points(grip.side, finger) for finger in FINGERS}
        self._R, self._p = np.empty((PART_COUNT, 3, 3)), np.empty((PART_COUNT, 3))
        self.angles = np.clip(grip.preshape, self._kinematics.lower, self._kinematics.upper)
        for stage in grip.stages:
            placed = np.isfinite(stage.angles)
            self.angles[placed] = stage.angles[placed]
            for joint in np.flatnonzero(np.isfinite(stage.torques)):
                self._close(int(joint), float(np.sign(stage.torques[joint])))

    def _near(self, finger: str, angles: Vector) -> _Near:
        """Return the clearances of a finger's sample points to the box, m, and where they are (box frame)."""
        part_frames(self._kinematics.tables, np.ascontiguousarray(angles), self._R, self._p)
        X = self._grip.X_box_palm
        clearance, parts, samples, surfaces = [], [], [], []
        for part, radius, axis in self._axes[finger]:
            p_palm = axis @ self._R[part].T + self._p[part]
            p_box = p_palm @ X[:3, :3].T + X[:3, 3]
            surface = np.clip(p_box, -self._half, self._half)
            clearance.append(np.linalg.norm(p_box - surface, axis=1) - radius)
            parts.append(np.full(len(axis), part))
            samples.append(p_box)
            surfaces.append(surface)
        return _Near(*(np.concatenate(rows) for rows in (clearance, parts, samples, surfaces)))

    def _close(self, joint: int, direction: float) -> None:
        """Turn one joint in its direction until its finger is on the surface, if it is not yet."""
        finger = next(name for name in FINGERS if joint in range(*finger_slice(name).indices(HAND_DOF)))
        lower, upper = self._kinematics.lower[joint], self._kinematics.upper[joint]

        def clearance(angle: float) -> float:
            angles = self.angles.copy()
            angles[joint] = angle
            return float(self._near(finger, angles).clearance.min())

        start = float(self.angles[joint])
        inside = -clearance(start)
        if inside > INSIDE_M:
            raise ValueError(
                f"{ACTUATED[joint]}: {finger} stands {1e3 * inside:.1f} mm inside the box before it closes"
            )
        if inside >= 0.0:
            return
        free = start
        while clearance(free + direction * _STEP) > 0.0:
            free += direction * _STEP
            if not lower <= free <= upper:
                raise ValueError(f"{ACTUATED[joint]}: finds nothing to touch before its limit")
        blocked = free + direction * _STEP
        for _ in range(30):
            middle = (free + blocked) / 2
            free, blocked = (middle, blocked) if clearance(middle) > 0.0 else (free, middle)
        self.angles[joint] = free

    def contacts(self) -> Contacts:
        """Return the outermost touching points of every part that touches."""
        X = self._grip.X_box_palm
        points: list[Matrix] = []
        normals: list[Matrix] = []
        jacobians: list[Matrix] = []
        parts: list[str] = []
        for finger in FINGERS:
            near = self._near(finger, self.angles)
            for part in np.unique(near.part):
                own = np.flatnonzero((near.part == part) & (near.clearance < TOUCHING_M))
                for k in _bearing(near, own):
                    inward = near.surface[k] - near.sample[k]
                    J = np.empty((3, HAND_DOF))
                    x_palm = X[:3, :3].T @ (near.surface[k] - X[:3, 3])
                    point_jacobian(self._kinematics.tables, self._R, self._p, int(part), x_palm, J)
                    points.append(near.surface[k])
                    normals.append(inward / np.linalg.norm(inward))
                    jacobians.append(X[:3, :3] @ J)
                    parts.append(_NAMES[int(part)])
        return Contacts(np.array(points), np.array(normals), np.array(jacobians), tuple(parts), self.angles.copy())


def _bearing(near: _Near, own: NDArray[np.int64]) -> list[int]:
    """Return the ends of a line of points that touch flatly, and the nearest point where that touches an edge."""
    if not len(own):
        return []
    inward = near.surface[own] - near.sample[own]
    flat = own[np.count_nonzero(np.abs(inward) > 1e-9, axis=1) == 1]
    nearest = int(own[np.argmin(near.clearance[own])])
    chosen = {int(flat[0]), int(flat[-1])} if len(flat) else set[int]()
    return sorted(chosen if nearest in flat else chosen | {nearest})


def grip_contacts(grip: Grip, size: Matrix) -> Contacts:
    """Return where a grip touches a box of outer size (3,), m."""
    return ClosedGrip(grip, size).contacts()
