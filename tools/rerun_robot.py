"""Both arms and hands in the rerun viewer: drawn once from the URDF, moved by one column of joint transforms."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from preshape.hal.layout import LAYOUT, Side
from preshape.hal.transform import Matrix
from preshape.tools.display_urdf import display_urdf, visual_kinds
from preshape.tools.rerun_stream import RerunStream

ROOT = "world"
"""Root link of the URDF, and the entity below which everything is drawn."""
SOLID = rr.components.FillMode.Solid
_SHAPES = {"box": rr.Boxes3D, "cylinder": rr.Cylinders3D, "sphere": rr.Ellipsoids3D}


def quaternion_product(a: Matrix, b: Matrix) -> Matrix:
    """Return the products (..., 4) of quaternions, scalar last."""
    v, w, u, s = a[..., :3], a[..., 3:], b[..., :3], b[..., 3:]
    vector = w * u + s * v + np.cross(v, u)
    return np.concatenate([vector, w * s - np.sum(v * u, axis=-1, keepdims=True)], axis=-1)


def _turn(axis: Matrix, angle: Matrix) -> Matrix:
    """Return the quaternions (..., 4) that turn about unit axes (..., 3) by angles (...), rad."""
    half = angle[..., None] / 2
    return np.concatenate([axis * np.sin(half), np.cos(half)], axis=-1)


def _quaternion_rpy(rpy: Matrix) -> Matrix:
    """Return the quaternions (n, 4) of URDF angles (n, 3): about fixed x, then y, then z."""
    x, y, z = (_turn(np.tile(np.eye(3)[k], (len(rpy), 1)), rpy[:, k]) for k in range(3))
    return quaternion_product(z, quaternion_product(y, x))


class RerunRobot:
    """The robot of one stream."""

    def __init__(self, stream: RerunStream, X_world_base: Mapping[Side, Matrix]) -> None:
        """Draw the robot, once and for all."""
        self._stream = stream
        urdf = display_urdf(X_world_base)
        with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
            file.write(urdf)
            file.flush()
            # A prefix with a slash in it would become one part of the path.
            tree = rr.urdf.UrdfTree.from_file_path(file.name, ROOT, static_transform_entity_path=f"{ROOT}/fixed_joints")
        tree.log_urdf_to_recording(stream.native)
        # The URDF's frames hang on the one of the entity `world`.
        stream.keep(f"{ROOT}/frame", rr.Transform3D(parent_frame=f"tf#/{ROOT}", child_frame=ROOT))
        for link, kinds in visual_kinds(urdf).items():
            for path, kind in zip(tree.get_visual_geometry_paths(link), kinds, strict=True):
                stream.keep(path, _SHAPES[kind].from_fields(fill_mode=SOLID))
        moving = [joint for joint in tree.joints() if joint.joint_type != "fixed"]
        drivers = [joint.name if joint.mimic is None else joint.mimic.joint for joint in moving]
        self._columns = np.array([LAYOUT.index(name) for name in drivers])
        self._axes = np.array([joint.axis for joint in moving])
        self._translation = np.array([joint.origin_xyz for joint in moving])
        self._zero = _quaternion_rpy(np.array([joint.origin_rpy for joint in moving]))
        self._parents, self._children = [j.parent_link for j in moving], [j.child_link for j in moving]

    def turns(self, position: Matrix) -> Matrix:
        """Return each moving joint's orientation in its parent (n, joints, 4) at positions (n, 40), rad."""
        return quaternion_product(self._zero, _turn(self._axes, position[:, self._columns]))

    def send(self, now_ns: NDArray[np.int64], position: Matrix) -> None:
        """Move the robot: positions (n, 40), rad, at times (n,)."""
        count, joints = len(now_ns), len(self._columns)
        columns = rr.Transform3D.columns(
            translation=np.tile(self._translation, (count, 1)),
            quaternion=self.turns(position).reshape(-1, 4),
            parent_frame=self._parents * count,
            child_frame=self._children * count,
        )
        self._stream.send(f"{ROOT}/joints", np.repeat(now_ns, joints), columns)
