"""The surroundings over Zenoh: from the controller's knowledge and from what it has been told, and back again."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import PIL.Image
from numpy.typing import NDArray

from preshape.hal.answers import AnyAnswer, ImageAnswer, ObstaclesAnswer
from preshape.hal.layout import SIDES, Side
from preshape.hal.tick_record import TickRecord
from preshape.hal.transform import Matrix, quaternion_xyzw, rotation_xyzw, transform
from preshape.hal.world import FACES, CameraModel, Face, NominalBox, OrientedBox, Workcell
from preshape.tools.telemetry_messages import (
    BodyState,
    CameraInfo,
    ImageState,
    Message,
    OpeningState,
    Point,
    SceneInfo,
    SceneState,
)
from preshape.tools.telemetry_states import numbers

JPEG_QUALITY = 80


def scene_info(cell: Workcell, box: NominalBox) -> SceneInfo:
    """Return what the controller knows of its surroundings and of the object."""
    camera = cell.camera
    return SceneInfo(
        bodies=[body_state(static) for static in cell.statics],
        object_size=numbers(box.size),
        tab_size=numbers(box.tab_size),
        candidate_faces=list(box.candidate_faces),
        camera=CameraInfo(
            **_pose(camera.X_world_camera), focal_px=camera.focal_px, width=camera.width, height=camera.height
        ),
    )


def surroundings(info: SceneInfo, X_world_base: dict[Side, Matrix]) -> tuple[Workcell, NominalBox]:
    """Return workcell and object as `scene_info` has described them; `X_world_base` comes from the URDF."""
    c = info.camera
    camera = CameraModel(_matrix(c.position, c.orientation_xyzw), c.focal_px, c.width, c.height)
    statics = tuple(oriented_box(body) for body in info.bodies)
    faces: tuple[Face, ...] = tuple(face for face in FACES if face in info.candidate_faces)
    tab = _array(info.tab_size)
    box = NominalBox(_array(info.object_size), faces, tab_size=(float(tab[0]), float(tab[1])))
    return Workcell({side: X_world_base[side] for side in SIDES}, statics, camera), box


def body_state(box: OrientedBox) -> BodyState:
    """Return a box as a message."""
    return BodyState(name=box.name, **_pose(box.X_world_box), size=numbers(2.0 * box.half))


def oriented_box(body: BodyState) -> OrientedBox:
    """Return the box that a message describes."""
    return OrientedBox(body.name, _matrix(body.position, body.orientation_xyzw), _array(body.size) / 2.0)


class SceneWatch:
    """Turns what happens around the robot into messages, each when it changes."""

    def __init__(self) -> None:
        """Begin with nothing seen."""
        self.wall_offset_ns = 0
        self._seq = {"state/scene": 0, "state/camera": 0}
        self._obstacles: list[BodyState] = []
        self._opening: OpeningState | None = None

    def hear(self, answer: AnyAnswer, pixels: NDArray[np.uint8] | None) -> list[tuple[str, Message]]:
        """Return what an answer of the perception changes: key tails and messages."""
        if isinstance(answer, ObstaclesAnswer):
            self._obstacles = [body_state(box) for box in answer.obstacles]
            return [self._scene(answer.now_ns)]
        if isinstance(answer, ImageAnswer) and pixels is not None:
            data = BytesIO()
            PIL.Image.fromarray(pixels).save(data, "jpeg", quality=JPEG_QUALITY)
            height, width = pixels.shape
            stamps = self._stamps("state/camera", answer.now_ns)
            return [("state/camera", ImageState(**stamps, width=width, height=height, jpeg=data.getvalue()))]
        return []

    def see(self, record: TickRecord) -> list[tuple[str, Message]]:
        """Return what the newest record changes."""
        opening = opening_state(record)
        if opening == self._opening:
            return []
        self._opening = opening
        return [self._scene(int(record["now_ns"]))]

    def _scene(self, now_ns: int) -> tuple[str, Message]:
        stamps = self._stamps("state/scene", now_ns)
        return "state/scene", SceneState(**stamps, obstacles=self._obstacles, opening=self._opening)

    def _stamps(self, tail: str, now_ns: int) -> dict[str, int]:
        self._seq[tail] += 1
        return {"seq": self._seq[tail] - 1, "stamp_ns": now_ns + self.wall_offset_ns, "mono_ns": now_ns}


def opening_state(record: TickRecord) -> OpeningState | None:
    """Return where the opening has been found; None before."""
    face, edge = int(record["opening_face"]), int(record["opening_edge"])
    if face < 0:
        return None
    return OpeningState(face=FACES[face], edge=FACES[edge], offset=float(record["opening_offset"]))


def _pose(X: Matrix) -> dict[str, Point]:
    return {"position": numbers(X[:3, 3]), "orientation_xyzw": numbers(quaternion_xyzw(X[:3, :3]))}


def _matrix(position: Point, orientation_xyzw: Point) -> Matrix:
    return transform(_array(position), rotation_xyzw(_array(orientation_xyzw)))


def _array(values: Point) -> Matrix:
    return np.array(values, float)
