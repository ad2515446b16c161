"""Objects that are no boxes, by name: the convex primitives they are put together from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from preshape.hal.transform import Matrix, transform

ShapeName = Literal["box", "l_carton", "cylinder"]

L_ARM_SHARE = 0.4
"""Thickness of both arms of an L-shaped carton, as a share of the shorter one of its edges x and z."""


@dataclass(frozen=True, slots=True, eq=False)
class Primitive:
    """One convex part: a box of outer `size` (3,) m, or a cylinder along z of that diameter (x = y) and height (z).

    `X_object_part` is its pose in the object's frame, which lies at the centre of the object's outer size.
    """

    name: str
    kind: Literal["box", "cylinder"]
    size: Matrix
    X_object_part: Matrix


def primitives(shape: ShapeName, size_m: tuple[float, float, float]) -> tuple[Primitive, ...]:
    """Return the parts of a shape of outer size (x, y, z), m.

    An L-carton stands on its foot (along x), the upright (z) at the foot's -x end. A cylinder runs along z.

    Raises:
        ValueError: a cylinder whose x and y differ.
    """
    x, y, z = size_m
    if shape == "cylinder":
        if abs(x - y) > 1e-9:
            raise ValueError(f"box.size_m: got {x:g} and {y:g} m for x and y, a cylinder needs the same: its diameter")
        return (Primitive("cylinder", "cylinder", np.array(size_m), np.eye(4)),)
    if shape == "l_carton":
        arm = L_ARM_SHARE * min(x, z)
        upright, foot = np.array([arm, y, z]), np.array([x - arm, y, arm])
        return (
            Primitive("upright", "box", upright, transform(((arm - x) / 2.0, 0.0, 0.0))),
            Primitive("foot", "box", foot, transform((arm / 2.0, 0.0, (arm - z) / 2.0))),
        )
    return (Primitive("box", "box", np.array(size_m), np.eye(4)),)
