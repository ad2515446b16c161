"""What the controller is told about the workcell and the object: nominal values, never simulator truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from preshape.hal.layout import Side
from preshape.hal.transform import Matrix

Face = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
FACES: tuple[Face, ...] = ("+x", "-x", "+y", "-y", "+z", "-z")


def face_normal(face: Face) -> Matrix:
    """Return the outward unit normal of a face of a box, in the box's frame."""
    normal = np.zeros(3)
    normal["xyz".index(face[1])] = 1.0 if face[0] == "+" else -1.0
    return normal


def opposite(face: Face) -> Face:
    """Return the parallel face on the other side."""
    return FACES[FACES.index(face) ^ 1]


@cache
def long_faces(long_axis: int) -> tuple[Face, Face, Face, Face]:
    """Return the four faces along the longest edge; 0 and 1 are opposite, 2 and 3 too."""
    faces: list[Face] = [face for face in FACES if face[1] != "xyz"[long_axis]]
    a, b, c, d = faces
    return a, b, c, d


@cache
def end_caps(long_axis: int) -> tuple[Face, Face]:
    """Return the faces at the negative and at the positive end of the longest edge."""
    return FACES[2 * long_axis + 1], FACES[2 * long_axis]


@dataclass(frozen=True, slots=True, eq=False)
class OrientedBox:
    """A box obstacle or body: its pose in the world and its half edges, m."""

    name: str
    X_world_box: Matrix
    half: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class NominalBox:
    """The paper box as the controller knows it: outer size (m) and the faces that may carry the opening."""

    size: Matrix
    candidate_faces: tuple[Face, ...]
    mass_range: tuple[float, float] = (0.05, 0.30)
    friction_range: tuple[float, float] = (0.4, 0.8)
    tab_size: tuple[float, float] = (0.045, 0.040)

    @property
    def long_axis(self) -> int:
        """Index of the longest edge's direction."""
        return int(np.argmax(self.size))

    @property
    def closed_sides(self) -> tuple[Face, ...]:
        """The faces along the longest edge that cannot carry the opening."""
        return tuple(face for face in long_faces(self.long_axis) if face not in self.candidate_faces)


@dataclass(frozen=True, slots=True)
class Opening:
    """An opening area.

    `face` carries it; `edge` is the long edge where the tab lies, named by the face beyond it; `offset` is the
    tab centre's distance from the middle along the long axis, m.
    """

    face: Face
    edge: Face
    offset: float


@dataclass(frozen=True, slots=True, eq=False)
class CameraModel:
    """A pinhole camera: pose (z forward, x right, y down), focal length and size, px; principal point in the middle."""

    X_world_camera: Matrix
    focal_px: float
    width: int
    height: int


@dataclass(frozen=True, slots=True, eq=False)
class Workcell:
    """Everything fixed around the task: arm bases, table and other static bodies, the camera."""

    X_world_base: Mapping[Side, Matrix]
    statics: tuple[OrientedBox, ...]
    camera: CameraModel
    table_height: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PoseSample:
    """One estimate of the box's pose, as old as `now - stamp_ns`."""

    stamp_ns: int
    X_world_box: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """One grey image (0 .. 255) and when it was taken."""

    stamp_ns: int
    pixels: NDArray[np.uint8]
    model: CameraModel


class Perception(Protocol):
    """The sensors of the scene that are not joints."""

    def object_pose(self, now_ns: int) -> PoseSample | None:
        """Return the newest estimate that has arrived, or None before the first."""
        ...

    def obstacles(self, now_ns: int) -> tuple[OrientedBox, ...]:
        """Return the obstacles seen up to now, besides the workcell's static bodies."""
        ...

    def image(self, now_ns: int) -> Image:
        """Take an image; costs milliseconds, so it is asked for, never streamed."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class TextureLibrary:
    """The known look of the opening area: grey patches keyed by what they show."""

    opening: NDArray[np.uint8]
    pixels_per_m: float
    extent_m: tuple[float, float] = field(default=(0.045, 0.040))
