"""What a MuJoCo scene looks like, drawn by the software renderer."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.transform import transform
from preshape.tools.raster import Picture, look_at, render
from preshape.tools.shape import Color, Kind, Shape

HIDDEN_GROUP = 3
"""Geoms of this group and above are not drawn."""
PLANE_HALF = 2.0
"""Half edge of an unbounded plane as drawn, m."""
DEFAULT_EYE = (1.75, -1.05, 1.20)
DEFAULT_TARGET = (0.30, -0.06, 0.30)

_GEOM = mujoco.mjtGeom
_KINDS: dict[int, Kind] = {
    int(_GEOM.mjGEOM_BOX): "box", int(_GEOM.mjGEOM_CAPSULE): "capsule",
    int(_GEOM.mjGEOM_CYLINDER): "cylinder", int(_GEOM.mjGEOM_ELLIPSOID): "ellipsoid",
}  # fmt: skip

_UNCOLORED = (0.5, 0.5, 0.5)
_HUES: dict[str, Color] = {
    "right_arm": (0.78, 0.82, 0.88), "left_arm": (0.88, 0.84, 0.78),
    "right_thumb": (0.86, 0.45, 0.35), "left_thumb": (0.86, 0.45, 0.35),
    "right": (0.40, 0.55, 0.78), "left": (0.42, 0.66, 0.55),
}  # fmt: skip
"""Colour of robot links whose model leaves it to us, by the beginning of the body's name, first match."""


def geom_color(model: mujoco.MjModel, geom: int) -> Color:
    """Return a geom's own colour, or its link's when the model leaves MuJoCo's default grey."""
    r, g, b = (float(value) for value in model.geom_rgba[geom, :3])
    return link_color(model.body(model.geom_bodyid[geom]).name) if (r, g, b) == _UNCOLORED else (r, g, b)


def link_color(link: str) -> Color:
    """Return the colour in which a link of the robot is drawn."""
    return next((hue for prefix, hue in _HUES.items() if link.startswith(prefix)), (0.7, 0.7, 0.72))


def geom_shape(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Shape:
    """Return the shape of one geom at the positions in `data`; a mesh is drawn as its oriented bounding box."""
    X = transform(data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3))
    kind, size, color = int(model.geom_type[geom]), model.geom_size[geom].copy(), geom_color(model, geom)
    if kind == _GEOM.mjGEOM_PLANE:
        half = np.where(size[:2] > 0, size[:2], PLANE_HALF)
        return Shape("box", X @ transform((0.0, 0.0, -0.005)), np.array([*half, 0.005]), color)
    if kind == _GEOM.mjGEOM_SPHERE:
        return Shape("ellipsoid", X, np.full(3, size[0]), color)
    if kind in _KINDS:
        return Shape(_KINDS[kind], X, size, color)
    center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    return Shape("box", X @ transform(center), np.maximum(half, 1e-4), color)


def shapes_of(model: mujoco.MjModel, data: mujoco.MjData) -> list[Shape]:
    """Return all visible geoms (groups below 3, not fully transparent); `data` must hold current kinematics."""
    visible = np.flatnonzero((model.geom_group < HIDDEN_GROUP) & (model.geom_rgba[:, 3] > 0))
    return [geom_shape(model, data, int(geom)) for geom in visible]


def view(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    eye: ArrayLike = DEFAULT_EYE,
    target: ArrayLike = DEFAULT_TARGET,
    width: int = 640,
    height: int = 480,
    height_angle: float = 0.7,
    extra: list[Shape] | None = None,
) -> Picture:
    """Return a picture of the scene from `eye` towards `target` (world, m), with `extra` shapes drawn in."""
    return render(shapes_of(model, data) + (extra or []), look_at(eye, target, height_angle), width, height)
