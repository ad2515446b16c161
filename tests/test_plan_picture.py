"""Laws of the plan's picture: what is drawn lies where the plan says."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from preshape.hal.description import ARM_BASE
from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.transform import transform
from preshape.hal.world import FACES, Face, face_normal
from preshape.planner.postures import PRESHAPE
from preshape.planner.preshaping_box import box_from_component
from preshape.sim_backend.robot_model import robot_spec
from preshape.tools import plan_drawing as drawing
from preshape.tools.plan_picture import plan_picture

TEA_BOX = drawing.PartDrawing(np.array([0.03, 0.045, 0.10]), cuts=(-0.033, 0.033))


def a_grasp(palm: Face = "+z", thumb: Face = "+y") -> drawing.GraspDrawing:
    """Return a grasp of the tea box's upper section."""
    box = box_from_component(palm, thumb, *TEA_BOX.section(2))
    tips = np.array([[0.0, 0.06, 0.07], [0.0, -0.06, 0.07]])
    X_object_palm = transform((0.0, 0.0, 0.3), np.diag([1.0, -1.0, -1.0]))
    return drawing.GraspDrawing("right hand", "right", 0, 2, box, tips, X_object_palm, PRESHAPE, notes=("a note",))


def test_sections_fill_the_part_without_overlap() -> None:
    corners = [TEA_BOX.section(k) for k in range(3)]
    assert corners[0][0][2] == -0.10
    assert corners[2][1][2] == 0.10
    for (_, upper), (lower, _) in zip(corners, corners[1:], strict=False):
        assert upper[2] == lower[2]
    with pytest.raises(ValueError, match="section 3"):
        TEA_BOX.section(3)


def test_patch_is_a_sheet_just_outside_its_face() -> None:
    for face in FACES:
        lower, upper = TEA_BOX.section(2)
        shape = drawing.patch_shape(TEA_BOX, (2, face), drawing.PALM)
        n = face_normal(face)
        surface = n @ np.where(n > 0, upper, lower)
        center = shape.X_world_shape[:3, 3]
        assert n @ center - np.abs(n) @ shape.size == pytest.approx(surface)
        across = np.abs(n) < 0.5
        assert np.allclose((center - shape.size)[across], lower[across])
        assert np.allclose((center + shape.size)[across], upper[across])


@pytest.mark.parametrize("side", SIDES)
def test_hand_is_drawn_as_the_simulated_model_stands(side: Side) -> None:
    model = robot_spec({s: transform(ARM_BASE[s]) for s in SIDES}).compile()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(2)
    hand = LAYOUT.hand(side)
    joints = rng.uniform(LAYOUT.lower[hand], LAYOUT.upper[hand])
    for name, angle in zip(LAYOUT.names[hand], joints, strict=True):
        data.joint(name).qpos[0] = angle
        if name.endswith("_pip"):
            data.joint(name.replace("_pip", "_dip")).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    palm = data.body(f"{side}_palm")
    X_world_palm = transform(palm.xpos, palm.xmat.reshape(3, 3))
    shapes = drawing.hand_shapes(side, X_world_palm, joints)
    assert len(shapes) == 18
    for shape, part in zip(shapes, drawing.sah_hand.PARTS, strict=True):
        geom = data.geom(f"{side}_{part}")
        assert np.allclose(shape.X_world_shape[:3, 3], geom.xpos, atol=1e-9)
        size = model.geom(f"{side}_{part}").size
        assert np.allclose(shape.size, size)
        axes = geom.xmat.reshape(3, 3).T @ shape.X_world_shape[:3, :3]
        assert abs(axes[2, 2]) == pytest.approx(1.0)


def test_component_is_drawn_on_palm_thumb_and_finger_face() -> None:
    grasp = a_grasp()
    shapes = drawing.component_shapes(TEA_BOX, grasp)
    assert [shape.color for shape in shapes] == [drawing.PALM, drawing.THUMB, drawing.FINGERS]
    assert shapes[0].X_world_shape[2, 3] > 0.1
    assert shapes[1].X_world_shape[1, 3] > 0.045
    assert shapes[2].X_world_shape[1, 3] < -0.045


def test_preshaping_boxs_edges_span_its_half_edges() -> None:
    grasp = a_grasp()
    edges = [shape for shape in drawing.box_shapes(grasp.box) if shape.color == drawing.FRAME]
    ends = [shape.X_world_shape @ [0, 0, s * shape.size[1], 1] for shape in edges for s in (-1, 1)]
    in_pb = np.array(ends) @ np.linalg.inv(grasp.box.X_object_pb).T
    assert len(edges) == 12
    assert np.allclose(np.abs(in_pb[:, :3]), grasp.box.half)


def test_picture_has_a_column_per_grasp_and_two_rows() -> None:
    plan = drawing.PlanDrawing((TEA_BOX,), (a_grasp(), a_grasp("+y", "-x")), frozenset({(1, "+x")}))
    picture = plan_picture(plan, 60, 50)
    assert picture.shape[1] == 3 * 66 + 6
    assert picture.shape[0] > 2 * 56
    only_object = plan_picture(drawing.PlanDrawing((TEA_BOX,), ()), 60, 50)
    assert only_object.shape[1] == 72


def test_l_carton_is_drawn_by_its_parts_and_their_boxes() -> None:
    vertices = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    part = drawing.PartDrawing(np.full(3, 0.05), transform((0.05, 0.05, 0.05)), (), vertices)
    kinds = [shape.kind for shape in drawing.part_shapes(part)]
    assert kinds == ["convex"] + ["capsule"] * 12
