"""The box that opens: a rigid shell, a lid hinged on its far long edge, a tab hinged on the lid.

The lid frame has its origin at the middle of the hinge edge, x from the hinge to the tab's edge, z along
the face's outward normal. A positive lid angle opens outward, a positive tab angle swings inward.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from preshape.hal.transform import Matrix, cross, transform
from preshape.hal.world import FACES, Face, face_normal
from preshape.sim_backend.scenario import Scenario

WALL = 0.002
"""Thickness of every panel, m."""
LID_RANGE = np.deg2rad(170.0)
TAB_RANGE = np.deg2rad(150.0)
BOARD_KG_PER_M2 = 0.3
"""Areal density of the lid's and the tab's board (folding boxboard)."""
MAX_LID_SHARE = 0.2
"""The lid never carries more than this share of a very light box's mass."""
_PAPER_BIT, _OTHER_BIT = 2, 1


@dataclass(frozen=True, slots=True, eq=False)
class LidFrame:
    """Where lid and tab sit on the shell: X_box_lid, the lid's depth (hinge to tab edge) and half length, the tab."""

    X_box_lid: Matrix
    depth: float
    half_length: float
    tab_depth: float
    tab_half_length: float
    tab_offset: float


def lid_frame(scenario: Scenario) -> LidFrame:
    """Return the lid's frame of a drawn scenario, in the box's frame (origin at the box's centre)."""
    opening, half = scenario.opening, np.array(scenario.box.size_m) / 2
    normal, edge = face_normal(opening.face), face_normal(opening.edge)
    across = cross(normal, edge)
    hinge = normal * (np.abs(normal) @ half) - edge * (np.abs(edge) @ half)
    long_axis = np.eye(3)[int(np.argmax(half))]
    return LidFrame(
        X_box_lid=transform(hinge, np.column_stack([edge, across, normal])),
        depth=2 * float(np.abs(edge) @ half),
        half_length=float(np.abs(across) @ half),
        tab_depth=opening.tab_depth_m,
        tab_half_length=opening.tab_length_m / 2,
        tab_offset=opening.offset_m * float(across @ long_axis),
    )


def perforation_arms(frame: LidFrame, points: int) -> Matrix:
    """Return each perforation point's distance from the hinge, m.

    The points are spread evenly by length along the lid's three free edges, the tab's stretch left out.
    """
    near = 2 * (frame.half_length - frame.tab_half_length)
    side = frame.depth
    s = (np.arange(points) + 0.5) / points * (2 * side + near)
    return np.where(s < side, s, np.where(s < side + near, side, 2 * side + near - s))


def add_paper_box(spec: mujoco.MjSpec, scenario: Scenario, X_world_box: Matrix) -> None:
    """Add bodies `box`, `lid`, `tab`, their hinges and the two locks that perforations make."""
    frame = lid_frame(scenario)
    strengths, friction = scenario.strengths, scenario.box.friction
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, X_world_box[:3, :3].ravel())
    box = spec.worldbody.add_body(name="box", pos=X_world_box[:3, 3], quat=quat)
    box.add_freejoint(name="box")
    lid_area, tab_area = 2 * frame.depth * frame.half_length, 2 * frame.tab_depth * frame.tab_half_length
    panels = min(BOARD_KG_PER_M2 * lid_area, MAX_LID_SHARE * scenario.box.mass_kg)
    tab_mass = panels * tab_area / lid_area
    _add_shell(box, scenario, scenario.box.mass_kg - panels, friction)

    lid = _add_child(box, "lid", frame.X_box_lid)
    _add_hinge(
        lid, "lid", (0, -1, 0), LID_RANGE, strengths.crease_nm_per_rad * strengths.scale, strengths.crease_yield_rad
    )
    _add_lid_panels(lid, frame, panels - tab_mass, friction)

    X_lid_tab = transform((frame.depth - frame.tab_depth, frame.tab_offset, 0.0))
    tab = _add_child(lid, "tab", X_lid_tab)
    _add_hinge(
        tab, "tab", (0, 1, 0), TAB_RANGE, strengths.crease_nm_per_rad * strengths.scale / 2, strengths.crease_yield_rad
    )
    size = (frame.tab_depth / 2 - 0.0005, frame.tab_half_length - 0.0005, WALL / 2)
    _add_panel(tab, "tab", (frame.tab_depth / 2, 0.0, -WALL / 2), size, tab_mass, friction)
    for name in ("lid", "tab"):
        lock = spec.add_equality(name=f"{name}_perforation", type=mujoco.mjtEq.mjEQ_JOINT, name1=name)
        lock.solref = [0.004, 1.0]
    spec.add_exclude(bodyname1="box", bodyname2="tab")


def _add_child(parent: mujoco.MjsBody, name: str, X: Matrix) -> mujoco.MjsBody:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, X[:3, :3].ravel())
    return parent.add_body(name=name, pos=X[:3, 3], quat=quat)


def _add_hinge(
    body: mujoco.MjsBody, name: str, axis: tuple[int, int, int], upper: float, stiffness: float, plastic_yield: float
) -> None:
    joint = body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    joint.range, joint.limited = [0.0, upper], True
    joint.stiffness, joint.springyield = [stiffness, 0.0, 0.0], plastic_yield
    joint.damping, joint.armature = [2e-4, 0.0, 0.0], 1e-5


def _add_panel(
    body: mujoco.MjsBody,
    name: str,
    center: tuple[float, float, float] | Matrix,
    half: tuple[float, float, float] | Matrix,
    mass: float,
    friction: float,
) -> None:
    geom = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, pos=center, size=half, mass=mass)
    geom.friction = [friction, 0.003, 0.0001]
    geom.condim = 4
    geom.rgba = [0.85, 0.70, 0.45, 1.0] if not name.startswith(("lid", "tab")) else [0.55, 0.75, 0.45, 1.0]
    # The panels of one paper box meet at their creases: they touch everything but each other.
    geom.contype, geom.conaffinity = _PAPER_BIT, _OTHER_BIT


def _add_shell(box: mujoco.MjsBody, scenario: Scenario, mass: float, friction: float) -> None:
    half = np.array(scenario.box.size_m) / 2
    walls: list[tuple[Face, Matrix, Matrix]] = []
    for face in FACES:
        if face == scenario.opening.face:
            continue
        normal = face_normal(face)
        thick = np.abs(normal)
        walls.append((face, normal * (thick @ half - WALL / 2), half * (1 - thick) + thick * WALL / 2))
    volumes = np.array([np.prod(size) for _, _, size in walls])
    # The centre of mass is set by the walls' masses only for a symmetric box; the rest is a small weight inside.
    for (face, center, size), volume in zip(walls, volumes, strict=True):
        _add_panel(box, f"box_{face}", center, size, 0.6 * mass * volume / volumes.sum(), friction)
    content = np.array(scenario.box.center_of_mass_m)
    weight = box.add_geom(
        name="box_content", type=mujoco.mjtGeom.mjGEOM_BOX, pos=content, size=half * 0.3, mass=0.4 * mass
    )
    weight.contype = weight.conaffinity = 0
    weight.group = 4


def _add_lid_panels(lid: mujoco.MjsBody, frame: LidFrame, mass: float, friction: float) -> None:
    """Add the lid's three rectangles around the tab's hole."""
    inner = frame.depth - frame.tab_depth
    low, high = frame.tab_offset - frame.tab_half_length, frame.tab_offset + frame.tab_half_length
    rectangles = {
        "lid_hinge": (0.0, inner, -frame.half_length, frame.half_length),
        "lid_low": (inner, frame.depth, -frame.half_length, low),
        "lid_high": (inner, frame.depth, high, frame.half_length),
    }
    areas = {name: (x1 - x0) * (y1 - y0) for name, (x0, x1, y0, y1) in rectangles.items()}
    for name, (x0, x1, y0, y1) in rectangles.items():
        center = ((x0 + x1) / 2, (y0 + y1) / 2, -WALL / 2)
        half = ((x1 - x0) / 2, (y1 - y0) / 2, WALL / 2)
        _add_panel(lid, name, center, half, mass * areas[name] / sum(areas.values()), friction)
