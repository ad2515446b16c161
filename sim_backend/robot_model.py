"""The robot in MuJoCo: the shared URDF with capsules rounded off, joint drives, and the excluded neighbours."""

from __future__ import annotations

import mujoco
import numpy as np

from preshape.hal import sah_hand
from preshape.hal.description import capsule_links, robot_urdf
from preshape.hal.layout import LAYOUT, SIDES, Side, arm_joint_names
from preshape.hal.transform import Matrix

ARM_STIFFNESS = (4000.0, 4000.0, 4000.0, 4000.0, 2000.0, 2000.0, 1000.0)
"""Position loop gain of the arm modules, N m/rad (E)."""
ARM_DAMPING = (250.0, 250.0, 200.0, 200.0, 60.0, 60.0, 30.0)
"""Damping of the arm modules, N m s/rad (E)."""
ARM_ARMATURE = (0.30, 0.30, 0.25, 0.25, 0.10, 0.10, 0.10)
"""Rotor inertia at the joint, kg m2 (E)."""
FINGER_STIFFNESS = 20.0
"""Position loop gain of the finger modules, N m/rad (E)."""
FINGER_DAMPING = 0.4
"""Damping of the finger modules, N m s/rad (E)."""
FINGER_ARMATURE = 0.002
"""Rotor inertia at a finger joint, kg m2 (E)."""

_NEIGHBOURS = [("palm", f"{f}_{link}") for f in sah_hand.FOREFINGERS for link in ("base", "prox")] + [
    *[(f"{f}_base", f"{f}_mid") for f in sah_hand.FINGERS],
    ("palm", "thumb_base"),
    ("palm", "thumb_opp"),
    ("thumb_opp", "thumb_base"),
    ("thumb_opp", "thumb_prox"),
]
"""Pairs of hand parts whose simplified shapes overlap at their joints; they cannot touch in any other way."""


def robot_spec(X_world_base: dict[Side, Matrix]) -> mujoco.MjSpec:
    """Return an editable model of both arms and hands; each geom carries its link's name."""
    spec = mujoco.MjSpec.from_string(robot_urdf(X_world_base))
    spec.compiler.fusestatic = False
    rounded = capsule_links()
    for body in spec.bodies:
        for geom in body.geoms:
            geom.name = body.name
            if body.name in rounded:
                geom.type = mujoco.mjtGeom.mjGEOM_CAPSULE
                geom.size = [geom.size[0], geom.size[1] - geom.size[0], 0.0]
        if body.name != "world":
            body.gravcomp = 1.0
    for equality in spec.equalities:
        equality.solref = [0.004, 1.0]
    _exclude_neighbours(spec)
    _add_drives(spec)
    return spec


def _exclude_neighbours(spec: mujoco.MjSpec) -> None:
    for side in SIDES:
        for a, b in _NEIGHBOURS:
            spec.add_exclude(bodyname1=f"{side}_{a}", bodyname2=f"{side}_{b}")
        links = [f"{side}_arm_link{n}" for n in range(8)] + [f"{side}_palm"]
        for first, a in enumerate(links):
            for b in links[first + 1 : first + 4]:
                spec.add_exclude(bodyname1=a, bodyname2=b)
        spec.add_exclude(bodyname1=f"{side}_arm_link7", bodyname2=f"{side}_thumb_opp")


def _add_drives(spec: mujoco.MjSpec) -> None:
    """Give every actuated joint a position loop (gain, damping) whose torque is clipped at its limit."""
    arm = {name: number % 7 for side in SIDES for number, name in enumerate(arm_joint_names(side))}
    for joint in spec.joints:
        joint.actgravcomp = True
        if joint.name in arm:
            number = arm[joint.name]
            joint.armature = ARM_ARMATURE[number]
        else:
            joint.armature = FINGER_ARMATURE if joint.name in LAYOUT.names else 1e-4
            joint.damping = [0.002, 0.0, 0.0]
    for index, name in enumerate(LAYOUT.names):
        number = arm.get(name)
        stiffness = FINGER_STIFFNESS if number is None else ARM_STIFFNESS[number]
        damping = FINGER_DAMPING if number is None else ARM_DAMPING[number]
        drive = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.gaintype, drive.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        drive.gainprm[0] = stiffness
        drive.biasprm[:3] = [0.0, -stiffness, -damping]
        drive.forcelimited = True
        drive.forcerange = [-LAYOUT.torque[index], LAYOUT.torque[index]]


def joint_addresses(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the qpos and dof address of each of the 40 actuated joints, in layout order."""
    ids = [model.joint(name).id for name in LAYOUT.names]
    return model.jnt_qposadr[ids].copy(), model.jnt_dofadr[ids].copy()
