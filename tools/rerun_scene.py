"""What is around the robot in the rerun viewer: fixed bodies, camera, object with opening, obstacles, images."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import PIL.Image
import rerun as rr
from numpy.typing import NDArray

from preshape.hal.answers import AnyAnswer, ImageAnswer, ObstaclesAnswer
from preshape.hal.tick_record import TickRecord
from preshape.hal.transform import Matrix
from preshape.hal.world import FACES, CameraModel, NominalBox, Workcell, face_normal
from preshape.tools.lid_estimate import LidEstimate
from preshape.tools.rerun_robot import SOLID
from preshape.tools.rerun_stream import RerunStream

GREY = np.array([0x8E8E98FF], np.uint32)
PAPER = np.array([0xDEC494FF], np.uint32)
LID = np.array([0xF2E3C2FF], np.uint32)
TAB = np.array([0xE08040FF], np.uint32)
OBSTACLE = np.array([0xB05A5AFF], np.uint32)
GLASSY = rr.components.FillMode.TransparentFillMajorWireframe
"""The object is seen through: what hands aim at lies within its outline."""
SHEET_M = 0.001
"""Thickness of lid and tab as drawn, m."""
CAMERA_M = 0.15
"""Distance of the camera's image from its centre as drawn, m."""
JPEG_QUALITY = 80


def opening_boxes(box: NominalBox, face: int, edge: int, offset: float) -> tuple[Matrix, Matrix]:
    """Return the centres (2, 3) and half edges (2, 3), m, of the lid and of the tab, in the object's frame.

    `face` and `edge` are indices of `FACES`; the lid is the whole face, the tab lies at the edge.
    """
    n, e, along = face_normal(FACES[face]), face_normal(FACES[edge]), np.eye(3)[box.long_axis]
    half = box.size / 2
    lid = n * (half @ np.abs(n) + SHEET_M)
    tab = n * (half @ np.abs(n) + 2 * SHEET_M) + e * (half @ np.abs(e) - box.tab_size[1] / 2) + offset * along
    flat = half * (1 - np.abs(n)) + SHEET_M * np.abs(n)
    tab_half = box.tab_size[0] / 2 * along + box.tab_size[1] / 2 * np.abs(e) + SHEET_M * np.abs(n)
    return np.array([lid, tab]), np.array([flat, tab_half])


class RerunScene:
    """The surroundings of one stream; what is drawn of them is the controller's knowledge."""

    def __init__(self, stream: RerunStream, cell: Workcell, box: NominalBox) -> None:
        """Draw what is fixed."""
        self._stream, self._box = stream, box
        self._X_world_base = cell.X_world_base["right"]
        self._opening: tuple[int, int, float] | None = None
        self._estimate: LidEstimate | None = None
        stream.keep("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for static in cell.statics:
            X, path = static.X_world_box, f"world/{static.name}"
            stream.keep(path, rr.Transform3D(translation=X[:3, 3], mat3x3=X[:3, :3]))
            stream.keep(path, rr.Boxes3D(half_sizes=[static.half], colors=GREY, fill_mode=SOLID))
        self._draw_camera(cell.camera)
        stream.keep("world/object", rr.Boxes3D(half_sizes=[box.size / 2], colors=PAPER, fill_mode=GLASSY))

    def send(self, records: TickRecord) -> None:
        """Move the object to where it was believed to be in records (n,)."""
        seen = records[~np.isnan(records["X_world_object"][:, 0, 0])]
        X = seen["X_world_object"]
        columns = rr.Transform3D.columns(translation=X[:, :3, 3], mat3x3=X[:, :3, :3])
        self._stream.send("world/object", seen["now_ns"], columns)
        if len(records):
            self._draw_opening(records[-1])
        self._turn_lid(records)

    def add_answer(self, answer: AnyAnswer, pixels: NDArray[np.uint8] | None) -> None:
        """Draw what the controller has been told: obstacles where they are seen, an image as it was taken."""
        now_ns = np.array([answer.now_ns])
        if isinstance(answer, ObstaclesAnswer):
            for obstacle in answer.obstacles:
                X, path = obstacle.X_world_box, f"world/obstacles/{obstacle.name}"
                self._stream.keep(path, rr.Boxes3D(half_sizes=[obstacle.half], colors=OBSTACLE, fill_mode=SOLID))
                columns = rr.Transform3D.columns(translation=X[None, :3, 3], mat3x3=X[None, :3, :3])
                self._stream.send(path, now_ns, columns)
        elif isinstance(answer, ImageAnswer) and pixels is not None:
            self.add_image(now_ns, pixels)

    def add_image(self, now_ns: NDArray[np.int64], pixels: NDArray[np.uint8]) -> None:
        """Show one grey image (height, width) from a time (1,) on."""
        data = BytesIO()
        PIL.Image.fromarray(pixels).save(data, "jpeg", quality=JPEG_QUALITY)
        columns = rr.EncodedImage.columns(blob=[data.getvalue()], media_type=["image/jpeg"])
        self._stream.send("world/camera/image", now_ns, columns)

    def _draw_camera(self, camera: CameraModel) -> None:
        X = camera.X_world_camera
        lens = rr.Pinhole(
            focal_length=camera.focal_px,
            width=camera.width,
            height=camera.height,
            image_plane_distance=CAMERA_M,
            camera_xyz=rr.ViewCoordinates.RDF,
        )
        self._stream.keep("world/camera", rr.Transform3D(translation=X[:3, 3], mat3x3=X[:3, :3]))
        self._stream.keep("world/camera", lens)

    def _draw_opening(self, record: TickRecord) -> None:
        """Draw lid and tab on the object from the moment on at which they are found."""
        found = int(record["opening_face"]), int(record["opening_edge"]), float(record["opening_offset"])
        if found[0] < 0 or found == self._opening:
            return
        self._opening, self._estimate = found, LidEstimate.of_record(self._X_world_base, self._box, record)
        centers, halves = opening_boxes(self._box, *found)
        at = np.array([int(record["now_ns"])])
        for name, center, half, color in zip(("lid", "tab"), centers, halves, (LID, TAB), strict=True):
            path = f"world/object/{name}"
            self._stream.keep(path, rr.Boxes3D.from_fields(colors=color, fill_mode=SOLID))
            self._stream.send(path, at, rr.Boxes3D.columns(half_sizes=[half], centers=[center]))

    def _turn_lid(self, records: TickRecord) -> None:
        """Move tab and lid as far as the thumb has moved them."""
        estimate = self._estimate
        if estimate is None:
            return
        moved = [
            (record["now_ns"], estimate.X_box_lid, estimate.X_box_tab) for record in records if estimate.update(record)
        ]
        if not moved:
            return
        now_ns, *poses = (np.array(column) for column in zip(*moved, strict=True))
        for name, X in zip(("lid", "tab"), poses, strict=True):
            columns = rr.Transform3D.columns(translation=X[:, :3, 3], mat3x3=X[:, :3, :3])
            self._stream.send(f"world/object/{name}", now_ns, columns)
