"""Laws of the offset that the field gives a hand on a motion that is given."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from preshape.control.approach import OPENING, FieldGuide
from preshape.control.body import Body
from preshape.control.contact_policy import Phase
from preshape.control.deflection import Deflection
from preshape.control.field import FieldOptions, HandGoal
from preshape.control.link_boxes import hand_nodes
from preshape.control.obstacles import Kind
from preshape.control.opening_motion import thumb_out
from preshape.control.sight import Sight
from preshape.hal.layout import LAYOUT, finger_slice
from preshape.hal.sah_hand import PARTS
from preshape.hal.state import RobotState
from preshape.hal.transform import Matrix, inverse, transform
from preshape.hal.world import Face, NominalBox, Opening, OrientedBox
from preshape.planner.work_object import box_object
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell

CELL = workcell(Scenario(name="cell"))
BOX = NominalBox(np.array([0.06, 0.09, 0.20]), ("+x", "-x"))
EASY = np.array([-1.372, -0.859, 1.185, -2.359, 0.814, 1.836, -0.890])
HAND = LAYOUT.hand("right")
FAR = transform((0.0, 0.0, 5.0))


class Bench:
    """A hand that is where its motion has it, the box somewhere, and obstacles that appear."""

    def __init__(self, X_palm_box: Matrix | None = None, face: Face = "+x") -> None:
        self.body = Body(CELL, 0.002)
        q = 0.5 * (LAYOUT.lower + LAYOUT.upper)
        q[LAYOUT.arm("right")], q[HAND] = EASY, thumb_out()
        self.body.follow(q, np.zeros(LAYOUT.dof))
        zero = np.zeros(LAYOUT.dof)
        self.body.update(0, RobotState(0, q, zero, zero, np.zeros(LAYOUT.dof, np.int64)))
        X = FAR if X_palm_box is None else self.body.palm("right") @ X_palm_box
        self.sight = SimpleNamespace(estimate=object(), X_world_box=X, obstacles=[])
        self.guide = FieldGuide(self.body, cast(Sight, self.sight), BOX, box_object(BOX), FieldOptions())
        self.guide.see_opening(Opening(face, "+y", 0.0))
        self.way = HandGoal(self.body.palm("right").copy(), q[HAND].copy())
        self.deflection = Deflection(self.guide, self.body, "right")
        self.deflection.head_for(self.way)

    def beside(self, part: str, gap: float) -> None:
        """Let an obstacle appear on the palm's -x side of a part of the hand, at a distance, m."""
        poses, node = self.body.links.poses, hand_nodes("right").start + list(PARTS).index(part)
        R = self.body.palm("right")[:3, :3]
        reach = float(np.abs(poses.R_box[node].T @ R[:, 0]) @ self.body.links.half[node])
        p = poses.p_box[node] - R[:, 0] * (reach + gap + 0.005)
        box = OrientedBox("thing", transform(p, R), np.full(3, 0.005))
        self.sight.obstacles = [box]

    def run(self, ticks: int, phase: Phase) -> tuple[Matrix, Matrix]:
        """Return the palm's offset, m, and the joints' (13), rad, after some ticks."""
        asked = self.way
        for _ in range(ticks):
            asked = self.deflection.applied(self.way, phase)
        return asked.X_world_palm[:3, 3] - self.way.X_world_palm[:3, 3], asked.joints - self.way.joints


@pytest.mark.parametrize("phase", [Phase.BEFORE_CONTACT, Phase.AFTER_CONTACT, Phase.PINCH])
def test_where_nothing_is_near_the_motion_stays_as_it_is_given(phase: Phase) -> None:
    p, joints = Bench().run(50, phase)
    assert not p.any() and not joints.any()


@pytest.mark.parametrize("phase", [Phase.BEFORE_CONTACT, Phase.AFTER_CONTACT, Phase.PINCH])
def test_what_the_given_motion_comes_near_to_does_not_repel(phase: Phase) -> None:
    bench = Bench(transform((-0.06, 0.0, 0.17)))
    assert np.isfinite(bench.guide.field.evaluate().distance[0]).any()
    p, joints = bench.run(50, phase)
    assert not p.any() and not joints.any()


def test_before_contact_the_palm_gives_way_to_what_comes_near_and_comes_back_when_it_has_gone() -> None:
    bench = Bench()
    bench.beside("palm", 0.010)
    p, _ = bench.run(300, Phase.BEFORE_CONTACT)
    away = bench.body.palm("right")[:3, 0]
    assert p @ away > 0.002
    bench.sight.obstacles = [OrientedBox("thing", FAR, np.full(3, 0.005))]
    back = [float(np.linalg.norm(bench.run(100, Phase.BEFORE_CONTACT)[0])) for _ in range(12)]
    assert np.all(np.diff(back) < 0.0) and back[-1] < 0.05 * float(np.linalg.norm(p))


def test_after_contact_only_the_fingers_give_way() -> None:
    bench = Bench()
    bench.beside("middle_mid", 0.004)
    p, joints = bench.run(300, Phase.AFTER_CONTACT)
    assert not p.any() and not joints[finger_slice("thumb")].any()
    assert np.abs(joints[finger_slice("middle")]).max() > 0.01


def test_in_a_pinch_only_the_ring_finger_gives_way() -> None:
    for part, moves in (("fore_mid", False), ("ring_mid", True)):
        bench = Bench()
        bench.beside(part, 0.004)
        p, joints = bench.run(300, Phase.PINCH)
        assert not p.any()
        for finger in ("thumb", "fore", "middle"):
            assert not joints[finger_slice(finger)].any()
        assert bool(np.abs(joints[finger_slice("ring")]).max() > 0.005) is moves


def test_joints_keep_their_limits() -> None:
    bench = Bench()
    bench.way = HandGoal(bench.way.X_world_palm, LAYOUT.upper[HAND].copy())
    bench.beside("fore_mid", 0.002)
    asked = [bench.deflection.applied(bench.way, Phase.BEFORE_CONTACT).joints for _ in range(300)]
    assert np.all(np.array(asked) <= LAYOUT.upper[HAND]) and np.all(np.array(asked) >= LAYOUT.lower[HAND])


@pytest.mark.parametrize("face", ["+x", "-x"])
def test_the_opening_is_a_thin_plate_in_its_face_and_moves_with_the_box(face: Face) -> None:
    bench = Bench(transform((-0.06, 0.0, 0.17)), face)
    with pytest.raises(ValueError, match="'opening' exists already"):
        bench.guide.see_opening(Opening(face, "+y", 0.0))
    bench.guide.refresh()
    obstacles = bench.guide.obstacles
    body = obstacles.index(OPENING)
    assert obstacles.kinds[body] is Kind.OPENING and obstacles.names.count(OPENING) == 1
    box = obstacles.first[body]
    assert obstacles.last[body] == box + 1
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * obstacles.half[box]
    world = corners @ obstacles.R[box].T + obstacles.p[box]
    X = inverse(bench.sight.X_world_box)
    local = world @ X[:3, :3].T + X[:3, 3]
    outward = local[:, 0] * (1.0 if face == "+x" else -1.0)
    assert outward.max() == pytest.approx(0.03) and outward.min() == pytest.approx(0.028)
    np.testing.assert_allclose(np.abs(local[:, 1:]), [[0.045, 0.10]] * 8, atol=1e-12)
