"""The robot's one description: a URDF written from the tables, loaded by PlaCo and by MuJoCo alike.

Link names: `world`, `<side>_arm_link0` .. `link7`, `<side>_<part>` for the 18 parts of a hand and
`<side>_<finger>_tip` for its fingertip frames. URDF has no capsule: a capsule is written as a cylinder
of its straight length plus both radii, and `capsule_links` tells which links to round off again.
"""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree

import numpy as np

from preshape.hal import panda_arm, sah_hand
from preshape.hal.layout import SIDES, Side, arm_joint_names
from preshape.hal.transform import Matrix, cross, rpy_angles, rpy_matrix, transform

MOUNT_GAP = 0.010
"""Distance along z from the flange to the palm frame's origin, m."""

MOUNT_YAW: Mapping[Side, float] = {"right": np.pi / 4, "left": -np.pi / 4}
"""palm = Rz(yaw) x flange, rad."""

ARM_BASE: Mapping[Side, tuple[float, float, float]] = {"right": (0.0, -0.40, 0.10), "left": (0.0, 0.40, 0.10)}
"""Default position of both arm bases in the world, m (unrotated)."""


def mirror_y(side: Side, p: Matrix, R: Matrix) -> tuple[Matrix, Matrix]:
    """Return p and R unchanged for the right hand, mirrored in y for the left: M p and M R M."""
    if side == "right":
        return p, R
    M = np.diag([1.0, -1.0, 1.0])
    return M @ p, M @ R @ M


def joint_axis(side: Side, axis: tuple[float, float, float]) -> Matrix:
    """Return a joint's axis; a mirrored rotation turns about det(M) M a = (-ax, ay, -az)."""
    a = np.array(axis)
    return a if side == "right" else a * [-1.0, 1.0, -1.0]


def hand_joint_origin(side: Side, joint: sah_hand.HandJoint) -> Matrix:
    """Return X_parent_joint at angle zero of one hand joint."""
    p, R = mirror_y(side, np.array(joint.xyz), rpy_matrix(joint.rpy))
    return transform(p, R)


def part_box(side: Side, part: str) -> tuple[Matrix, Matrix]:
    """Return the centre and half edges (m, in the part's frame) of one hand part's bounding box b_i."""
    center, half = sah_hand.PARTS[part][0].bounding_box()
    return mirror_y(side, center, np.eye(3))[0], half


def palm_mount(side: Side) -> Matrix:
    """Return X_link7_palm: along the flange, then turned by the mount's yaw."""
    yaw = rpy_matrix((0.0, 0.0, MOUNT_YAW[side]))
    return transform((0.0, 0.0, panda_arm.FLANGE_OFFSET + MOUNT_GAP), yaw)


def capsule_links() -> frozenset[str]:
    """Return the links whose cylinders stand for capsules."""
    arms = {f"{side}_arm_link{capsule.link}" for side in SIDES for capsule in panda_arm.CAPSULES}
    hands = {f"{s}_{name}" for s in SIDES for name, (shape, _) in sah_hand.PARTS.items() if shape.kind == "capsule"}
    return frozenset(arms | hands)


def _text(values: Matrix) -> str:
    return " ".join(repr(round(float(value), 12)) for value in values)


def _origin(parent: ElementTree.Element, X: Matrix) -> None:
    ElementTree.SubElement(parent, "origin", xyz=_text(X[:3, 3]), rpy=_text(rpy_angles(X[:3, :3])))


def _box_inertia(mass: float, half: Matrix) -> Matrix:
    """Return the principal moments of a solid box about its centre: m/3 (b^2 + c^2), kg m2."""
    a, b, c = half**2
    return mass / 3.0 * np.array([b + c, a + c, a + b])


def _add_link(
    robot: ElementTree.Element,
    name: str,
    X_link_shape: Matrix,
    geometry: tuple[str, dict[str, str]],
    mass: float,
    half: Matrix,
) -> None:
    link = ElementTree.SubElement(robot, "link", name=name)
    inertial = ElementTree.SubElement(link, "inertial")
    _origin(inertial, X_link_shape)
    ElementTree.SubElement(inertial, "mass", value=str(mass))
    moments = np.maximum(_box_inertia(mass, half), 1e-6)
    ixx, iyy, izz = (repr(float(moment)) for moment in moments)
    ElementTree.SubElement(inertial, "inertia", ixy="0", ixz="0", iyz="0", ixx=ixx, iyy=iyy, izz=izz)
    for purpose in ("visual", "collision"):
        element = ElementTree.SubElement(link, purpose)
        _origin(element, X_link_shape)
        ElementTree.SubElement(ElementTree.SubElement(element, "geometry"), geometry[0], geometry[1])


def _add_joint(
    robot: ElementTree.Element,
    name: str,
    parent: str,
    child: str,
    X: Matrix,
    axis: Matrix | None = None,
    limits: dict[str, float] | None = None,
) -> ElementTree.Element:
    joint = ElementTree.SubElement(robot, "joint", name=name, type="fixed" if axis is None else "revolute")
    _origin(joint, X)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    if axis is not None and limits is not None:
        ElementTree.SubElement(joint, "axis", xyz=_text(axis))
        ElementTree.SubElement(joint, "limit", {key: repr(float(value)) for key, value in limits.items()})
    return joint


def _along(direction: Matrix) -> Matrix:
    """Return a rotation whose z axis points along a direction."""
    z = direction / np.linalg.norm(direction)
    x = cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, cross(z, x), z])


def _cylinder(radius: float, straight: float) -> tuple[str, dict[str, str]]:
    return "cylinder", {"radius": repr(radius), "length": repr(round(straight + 2 * radius, 9))}


def _add_arm(robot: ElementTree.Element, side: Side, X_world_base: Matrix) -> None:
    for number, capsule in enumerate(panda_arm.CAPSULES):
        start, end = np.array(capsule.start), np.array(capsule.end)
        straight = float(np.linalg.norm(end - start))
        X = transform((start + end) / 2, _along(end - start))
        half = np.array([capsule.radius, capsule.radius, straight / 2 + capsule.radius])
        mass = 3.0 if number == 0 else panda_arm.MASSES[number - 1]
        _add_link(robot, f"{side}_arm_link{number}", X, _cylinder(capsule.radius, straight), mass, half)
    _add_joint(robot, f"{side}_arm_mount", "world", f"{side}_arm_link0", X_world_base)
    for number, (name, joint) in enumerate(zip(arm_joint_names(side), panda_arm.JOINTS, strict=True)):
        X = transform(joint.xyz, rpy_matrix((joint.roll, 0.0, 0.0)))
        limits = {"lower": joint.lower, "upper": joint.upper, "velocity": joint.velocity, "effort": joint.torque}
        link = f"{side}_arm_link"
        _add_joint(robot, name, f"{link}{number}", f"{link}{number + 1}", X, np.array([0.0, 0.0, 1.0]), limits)


def _add_hand(robot: ElementTree.Element, side: Side) -> None:
    for part, (shape, mass) in sah_hand.PARTS.items():
        center, half = part_box(side, part)
        if shape.kind == "box":
            X = transform(center)
            geometry = "box", {"size": _text(2 * half)}
        else:
            radius, start, end = shape.size
            X = transform(center, _along(np.array([1.0, 0.0, 0.0])))
            geometry = _cylinder(radius, end - start)
            half = half[[1, 2, 0]]
        _add_link(robot, f"{side}_{part}", X, geometry, mass, half)
    for joint in sah_hand.JOINTS:
        limits = {
            "lower": joint.lower,
            "upper": joint.upper,
            "velocity": sah_hand.VELOCITY_LIMIT,
            "effort": joint.torque,
        }
        element = _add_joint(
            robot, f"{side}_{joint.name}", f"{side}_{joint.parent}", f"{side}_{joint.child}",
            hand_joint_origin(side, joint), joint_axis(side, joint.axis), limits,
        )  # fmt: skip
        if joint.coupled_to is not None:
            ElementTree.SubElement(element, "mimic", joint=f"{side}_{joint.coupled_to}", multiplier="1", offset="0")
    for finger in sah_hand.FINGERS:
        ElementTree.SubElement(robot, "link", name=f"{side}_{finger}_tip")
        X = transform((sah_hand.TIP_OFFSET, 0.0, 0.0))
        _add_joint(robot, f"{side}_{finger}_tip_mount", f"{side}_{finger}_dist", f"{side}_{finger}_tip", X)


def robot_urdf(X_world_base: Mapping[Side, Matrix] | None = None, hands: bool = True) -> str:
    """Return the URDF of both arms, with the hands or (for arm IK) with bare `<side>_palm` frames.

    `X_world_base` places the arm bases; the default is `ARM_BASE`, unrotated.
    """
    bases = X_world_base or {side: transform(ARM_BASE[side]) for side in SIDES}
    robot = ElementTree.Element("robot", name="preshape")
    ElementTree.SubElement(robot, "link", name="world")
    for side in SIDES:
        _add_arm(robot, side, bases[side])
        if hands:
            _add_hand(robot, side)
        else:
            ElementTree.SubElement(robot, "link", name=f"{side}_palm")
        _add_joint(robot, f"{side}_palm_mount", f"{side}_arm_link7", f"{side}_palm", palm_mount(side))
    return ElementTree.tostring(robot, encoding="unicode")
