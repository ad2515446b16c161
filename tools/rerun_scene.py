"""The moving robot, the fixed bodies and the object in a rerun recording."""

from __future__ import annotations

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from preshape.hal.layout import SIDES
from preshape.hal.sah_hand import FINGERS
from preshape.hal.tick_record import TickRecord
from preshape.hal.transform import Matrix
from preshape.hal.world import NominalBox, Workcell
from preshape.sim_backend.robot_model import joint_addresses, robot_spec
from preshape.tools.rerun_file import RerunFile
from preshape.tools.scene_view import geom_color

SOLID = rr.components.FillMode.Solid
GREY = np.array([0xA8A8B0FF], np.uint32)
PAPER = np.array([0xDEC494FF], np.uint32)


def body_poses(model: mujoco.MjModel, positions: Matrix) -> tuple[Matrix, Matrix]:
    """Return where all bodies are, p (n, bodies, 3), m, and R (n, bodies, 3, 3), at joint positions (n, 40), rad."""
    data = mujoco.MjData(model)
    addresses, _ = joint_addresses(model)
    coupled = _coupled(model)
    p, R = np.empty((len(positions), model.nbody, 3)), np.empty((len(positions), model.nbody, 3, 3))
    for row, position in enumerate(positions):
        data.qpos[addresses] = position
        data.qpos[coupled[:, 0]] = data.qpos[coupled[:, 1]]
        mujoco.mj_kinematics(model, data)
        p[row], R[row] = data.xpos, data.xmat.reshape(-1, 3, 3)
    return p, R


def _coupled(model: mujoco.MjModel) -> NDArray[np.int64]:
    """Return (n, 2): the position addresses of each coupled distal joint and of the joint it repeats."""
    pairs = [(f"{side}_{finger}_dip", f"{side}_{finger}_pip") for side in SIDES for finger in FINGERS]
    return np.array([[model.joint(name).qposadr[0] for name in pair] for pair in pairs])


def add_robot(file: RerunFile, records: TickRecord, workcell: Workcell) -> None:
    """Add both arms and hands as measured, moved by the shared description's kinematics."""
    model = robot_spec(dict(workcell.X_world_base)).compile()
    known = records[~np.isnan(records["position"][:, 0])]
    p, R = body_poses(model, known["position"])
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        path = f"world/robot/{model.body(body).name}"
        file.keep(path, geom_archetype(model, geom))
        file.add_poses(path, known["now_ns"], p[:, body], R[:, body])


def geom_archetype(model: mujoco.MjModel, geom: int) -> rr.Capsules3D | rr.Boxes3D:
    """Return a capsule or box of the robot in its body's frame."""
    size, center = model.geom_size[geom], model.geom_pos[geom]
    w, x, y, z = model.geom_quat[geom]
    color = np.array([[*(round(255 * c) for c in geom_color(model, geom)), 255]], np.uint8)
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_CAPSULE:
        return rr.Boxes3D(
            half_sizes=[size], centers=[center], quaternions=[[x, y, z, w]], colors=color, fill_mode=SOLID
        )
    # The viewer's capsule begins at its frame's origin, MuJoCo's lies around it.
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, model.geom_quat[geom])
    start = center - size[1] * R.reshape(3, 3)[:, 2]
    return rr.Capsules3D(
        lengths=[2 * size[1]], radii=[size[0]], translations=[start], quaternions=[[x, y, z, w]], colors=color,
        fill_mode=SOLID,
    )  # fmt: skip


def add_surroundings(file: RerunFile, records: TickRecord, workcell: Workcell, box: NominalBox) -> None:
    """Add the fixed bodies, and the object where it was believed to be."""
    for static in workcell.statics:
        X, path = static.X_world_box, f"world/{static.name}"
        file.keep(path, rr.Transform3D(translation=X[:3, 3], mat3x3=X[:3, :3]))
        file.keep(path, rr.Boxes3D(half_sizes=[static.half], colors=GREY, fill_mode=SOLID))
    seen = records[~np.isnan(records["X_world_object"][:, 0, 0])]
    X_world_object = seen["X_world_object"]
    file.keep("world/object", rr.Boxes3D(half_sizes=[box.size / 2], colors=PAPER, fill_mode=SOLID))
    file.add_poses("world/object", seen["now_ns"], X_world_object[:, :3, 3], X_world_object[:, :3, :3])
