"""The storyboard as one picture: every frame drawn from two viewpoints and captioned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from preshape.tools.caption import PAPER, captioned, grid, write
from preshape.tools.raster import Picture, look_at, render
from preshape.tools.scene_view import shapes_of
from preshape.tools.storyboard import Snapshot

TASK_NAMES: Mapping[int, str] = {1: "grasp", 2: "show", 3: "regrasp", 4: "crush", 5: "open"}


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A camera's eye and target (m): in the world, or relative to the object's position if `follows`."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    height_angle: float
    follows: bool = False


ViewpointName = Literal["whole", "close"]
VIEWPOINTS: Mapping[ViewpointName, Viewpoint] = {
    "whole": Viewpoint((1.65, -1.00, 1.15), (0.28, -0.08, 0.32), 0.66),
    "close": Viewpoint((-0.32, 0.42, 0.62), (0.0, 0.0, 0.0), 0.50, follows=True),
}
"""`whole` shows both arms and the table; `close` looks over the left shoulder at the object."""


def frame_picture(
    model: mujoco.MjModel, snapshot: Snapshot, viewpoint: Viewpoint, width: int, height: int, body: str = "box"
) -> Picture:
    """Return the scene at a snapshot as seen from a viewpoint; `body` is what a following one follows."""
    data = mujoco.MjData(model)
    data.qpos[:] = snapshot.qpos
    mujoco.mj_kinematics(model, data)
    origin = data.body(body).xpos if viewpoint.follows else np.zeros(3)
    camera = look_at(origin + viewpoint.eye, origin + viewpoint.target, viewpoint.height_angle)
    return render(shapes_of(model, data), camera, width, height)


def with_inset(picture: Picture, inset: Picture) -> Picture:
    """Return the picture with another in its lower right corner, framed."""
    framed = np.pad(inset, ((2, 0), (2, 0), (0, 0)), constant_values=60)
    out = picture.copy()
    out[-framed.shape[0] :, -framed.shape[1] :] = framed
    return out


def caption_of(number: int, snapshot: Snapshot, names: Mapping[int, str] = TASK_NAMES) -> str:
    """Return a frame's caption: its number, time, task and phase."""
    task = f"task {snapshot.task} {names.get(snapshot.task, '')}".rstrip()
    return f"({number})  {snapshot.time_s:.2f} s   {task}: {snapshot.phase}"


def storyboard_picture(
    model: mujoco.MjModel,
    frames: Sequence[Snapshot],
    main: ViewpointName = "whole",
    inset: ViewpointName | None = "close",
    title: str = "",
    width: int = 400,
    height: int = 300,
    columns: int = 5,
    names: Mapping[int, str] = TASK_NAMES,
) -> Picture:
    """Return all frames in a grid; the main viewpoint fills a frame, the other one its lower right corner.

    Sizes are in pixels, of one frame.
    """
    cells: list[Picture] = []
    for number, snapshot in enumerate(frames, 1):
        picture = frame_picture(model, snapshot, VIEWPOINTS[main], width, height)
        if inset is not None:
            small = frame_picture(model, snapshot, VIEWPOINTS[inset], round(0.42 * width), round(0.42 * height))
            picture = with_inset(picture, small)
        cells.append(captioned(picture, [caption_of(number, snapshot, names)]))
    sheet = grid(cells, columns)
    if title:
        sheet = np.vstack([write(np.full((30, sheet.shape[1], 3), PAPER, np.uint8), [title], 8, 6, 17), sheet])
    return sheet
