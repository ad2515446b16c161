"""An object that has no lid: rigid, put together from convex primitives that share its mass by their volumes."""

from __future__ import annotations

import mujoco
import numpy as np

from preshape.hal.object_shape import Primitive, primitives
from preshape.hal.transform import Matrix
from preshape.sim_backend.scenario import Scenario

BOARD = (0.85, 0.70, 0.45, 1.0)
"""Colour of every part."""
RING = 32
"""Points on the edge of a cylinder's end that stand for it."""


def add_solid_object(spec: mujoco.MjSpec, scenario: Scenario, X_world_object: Matrix) -> None:
    """Add the body `box` with one geom `box_<part>` for each primitive of the scenario's shape."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, X_world_object[:3, :3].ravel())
    body = spec.worldbody.add_body(name="box", pos=X_world_object[:3, 3], quat=quat)
    body.add_freejoint(name="box")
    parts = primitives(scenario.shape, scenario.box.size_m)
    volumes = np.array([volume(part) for part in parts])
    for part, mass in zip(parts, scenario.box.mass_kg * volumes / volumes.sum(), strict=True):
        _add_part(body, part, float(mass))


def volume(part: Primitive) -> float:
    """Return a primitive's volume, m3."""
    full = float(np.prod(part.size))
    return full if part.kind == "box" else full * np.pi / 4


def corners(scenario: Scenario) -> Matrix:
    """Return points (n, 3) of the object, in its frame, of which one is always among its lowest, m.

    Exact for boxes; on the round edges of a cylinder the nearest of `RING` points.
    """
    return np.vstack([_corners(part) for part in primitives(scenario.shape, scenario.box.size_m)])


def _corners(part: Primitive) -> Matrix:
    half = part.size / 2
    if part.kind == "cylinder":
        angles = 2 * np.pi * np.arange(RING) / RING
        ring = np.column_stack([half[0] * np.cos(angles), half[1] * np.sin(angles)])
        points = np.vstack([np.column_stack([ring, np.full(RING, z)]) for z in (-half[2], half[2])])
    else:
        points = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T * half
    return points @ part.X_object_part[:3, :3].T + part.X_object_part[:3, 3]


def _add_part(body: mujoco.MjsBody, part: Primitive, mass: float) -> None:
    kind = mujoco.mjtGeom.mjGEOM_BOX if part.kind == "box" else mujoco.mjtGeom.mjGEOM_CYLINDER
    geom = body.add_geom(name=f"box_{part.name}", type=kind, mass=mass, rgba=BOARD)
    half = part.size / 2
    geom.size = half if part.kind == "box" else [half[0], half[2], 0.0]
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, part.X_object_part[:3, :3].ravel())
    geom.pos, geom.quat = part.X_object_part[:3, 3], quat
