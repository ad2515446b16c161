"""The scene of a drawn scenario as one MuJoCo model: robot, table, camera column, box, obstacles."""

from __future__ import annotations

import mujoco
import numpy as np

from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, cross, rpy_matrix, transform
from preshape.hal.world import CameraModel, NominalBox, OrientedBox, Workcell, face_normal
from preshape.sim_backend.paper_box import add_paper_box
from preshape.sim_backend.robot_model import robot_spec
from preshape.sim_backend.scenario import ObstacleSection, Scenario
from preshape.sim_backend.solid_object import add_solid_object

TIMESTEP_S = 0.001
COLUMN_RADIUS = 0.07
COLUMN_X = -0.075


def rest_rotation(scenario: Scenario) -> Matrix:
    """Return R_world_box of the box lying on its rest face, turned by its yaw about the vertical."""
    down = face_normal(scenario.box.rest_face)
    up = -down
    x = np.eye(3)[(int(np.argmax(np.abs(up))) + 1) % 3]
    R_rest_box = np.vstack([x, cross(up, x), up])
    return rpy_matrix((0.0, 0.0, np.deg2rad(scenario.box.yaw_deg))) @ R_rest_box


def initial_box_pose(scenario: Scenario) -> Matrix:
    """Return X_world_box at the start: resting on the table at its position."""
    height = abs(face_normal(scenario.box.rest_face) @ np.array(scenario.box.size_m)) / 2
    return transform(np.array([*scenario.box.position_m, height]), rest_rotation(scenario))


def camera_model(scenario: Scenario) -> CameraModel:
    """Return the camera looking from its position to its target, image rows level."""
    camera = scenario.camera
    forward = np.array(camera.look_at_m) - np.array(camera.position_m)
    forward /= np.linalg.norm(forward)
    right = cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.column_stack([right, cross(forward, right), forward])
    return CameraModel(transform(camera.position_m, R), camera.focal_px, camera.width_px, camera.height_px)


def arm_bases(scenario: Scenario) -> dict[Side, Matrix]:
    """Return X_world_base of both arms."""
    return {"right": transform(scenario.arms.right_base_m), "left": transform(scenario.arms.left_base_m)}


def table_box(scenario: Scenario) -> OrientedBox:
    """Return the table as a box whose top is z = 0."""
    (x0, x1), (y0, y1), t = scenario.table.x_m, scenario.table.y_m, scenario.table.thickness_m
    center = np.array([(x0 + x1) / 2, (y0 + y1) / 2, -t / 2])
    return OrientedBox("table", transform(center), np.array([(x1 - x0) / 2, (y1 - y0) / 2, t / 2]))


def workcell(scenario: Scenario) -> Workcell:
    """Return what the controller is told of the fixed world."""
    column = OrientedBox(
        "column", transform((COLUMN_X, 0.0, 0.45)), np.array([COLUMN_RADIUS + 0.025, COLUMN_RADIUS, 0.45])
    )
    return Workcell(arm_bases(scenario), (table_box(scenario), column), camera_model(scenario))


def nominal_box(scenario: Scenario) -> NominalBox:
    """Return what the controller is told of the box: size and candidate faces (if it opens), not where it opens."""
    opening = scenario.opening
    candidates = opening.candidate_faces if scenario.shape == "box" else ()
    return NominalBox(np.array(scenario.box.size_m), candidates, tab_size=(opening.tab_length_m, opening.tab_depth_m))


CONTACT_TIME_S = 0.006
"""Time constant of contacts, s.

MuJoCo's friction rows hold the sliding speed at zero but leave out the contact frame's own turning (dJ/dt v): in
a hand that turns at w, what it holds creeps outward at about w^2 r T_c / 2, with T_c this constant. The default
of 20 ms let a firmly held box creep 2.5 mm in one turn; 6 ms, six time steps, is stiff and still stable.
"""


def build_scene(scenario: Scenario) -> mujoco.MjModel:
    """Return the compiled model of a drawn scenario."""
    spec = robot_spec(arm_bases(scenario))
    option = spec.option
    option.timestep = TIMESTEP_S
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone, option.impratio, option.noslip_iterations = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0, 5
    _add_statics(spec, scenario)
    add_object = add_paper_box if scenario.shape == "box" else add_solid_object
    add_object(spec, scenario, initial_box_pose(scenario))
    for obstacle in scenario.obstacles:
        _add_obstacle(spec, obstacle)
    # MuJoCo takes the larger friction of a pair: every geom gets the scenario's.
    for body in spec.bodies:
        for geom in body.geoms:
            geom.friction = [scenario.box.friction, 0.003, 0.0001]
            geom.condim = 4
            geom.solref = [CONTACT_TIME_S, 1.0]
    return spec.compile()


def _add_statics(spec: mujoco.MjSpec, scenario: Scenario) -> None:
    table = table_box(scenario)
    geom = spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX)
    geom.pos, geom.size, geom.rgba = table.X_world_box[:3, 3], table.half, [0.75, 0.75, 0.78, 1.0]
    column = spec.worldbody.add_geom(name="column", type=mujoco.mjtGeom.mjGEOM_CAPSULE)
    column.fromto = [COLUMN_X, 0.0, 0.0, COLUMN_X, 0.0, 0.8]
    column.size = [COLUMN_RADIUS, 0.0, 0.0]
    for static in (geom, column):
        static.contype, static.conaffinity = 3, 3


def _add_obstacle(spec: mujoco.MjSpec, obstacle: ObstacleSection) -> None:
    body = spec.worldbody.add_body(name=f"obstacle_{obstacle.name}", mocap=True)
    body.pos = obstacle.position_m
    half_yaw = np.deg2rad(obstacle.yaw_deg) / 2
    body.quat = [np.cos(half_yaw), 0.0, 0.0, np.sin(half_yaw)]
    geom = body.add_geom(name=f"obstacle_{obstacle.name}", type=mujoco.mjtGeom.mjGEOM_BOX)
    geom.size = np.array(obstacle.size_m) / 2
