"""Objects without a lid as the scene has them: one body of convex parts that stands still and is judged as a whole."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.hal.object_shape import primitives
from preshape.sim_backend.contact_rules import CLASS, geom_classes
from preshape.sim_backend.referee import Referee
from preshape.sim_backend.scene import build_scene, initial_box_pose
from preshape.sim_backend.simulation import Simulation
from preshape.sim_backend.solid_object import corners, volume
from preshape.tools.configuration import load_scenario

NAMES = ("l_carton", "cylinder")


@pytest.mark.parametrize("name", NAMES)
def test_one_body_has_the_shapes_mass_and_centre_of_mass(name: str) -> None:
    drawn = load_scenario(name).drawn(0)
    model = build_scene(drawn)
    body = model.body("box")
    parts = primitives(drawn.shape, drawn.box.size_m)
    assert body.mass[0] == pytest.approx(drawn.box.mass_kg)
    volumes = np.array([volume(part) for part in parts])
    centre = volumes @ np.array([part.X_object_part[:3, 3] for part in parts]) / volumes.sum()
    np.testing.assert_allclose(body.ipos, centre, atol=1e-9)
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body.id]
    assert [model.geom(g).name for g in geoms] == [f"box_{part.name}" for part in parts]
    assert np.all(geom_classes(model)[geoms] == CLASS["shell"])


@pytest.mark.parametrize("name", NAMES)
def test_it_stands_still_on_the_table_and_nothing_is_held_against_it(name: str) -> None:
    drawn = load_scenario(name).drawn(0)
    simulation = Simulation(drawn)
    referee = Referee(simulation)
    simulation.step(500)
    X, X_start = simulation.X_world_box, initial_box_pose(drawn)
    assert np.abs(X[:3, 3] - X_start[:3, 3]).max() < 1e-4
    assert np.abs(X[:3, :3] - X_start[:3, :3]).max() < 1e-3
    verdict = referee.verdict()
    assert verdict.undesired_contacts == () and not verdict.dropped and not verdict.crushed
    assert verdict.failures == ("task 1 (grasp) not done", "task 2 (hold) not done")
    # Landing on the contacts' first step presses a little more than the weight does.
    weight_n = drawn.box.mass_kg * 9.81
    assert 0.95 * weight_n < verdict.max_panel_load_n["-z"] < 1.3 * weight_n


@pytest.mark.parametrize("name", NAMES)
def test_its_corners_reach_its_outer_size_and_no_further(name: str) -> None:
    drawn = load_scenario(name).drawn(0)
    points = corners(drawn)
    half = np.array(drawn.box.size_m) / 2
    np.testing.assert_allclose(points.max(axis=0), half, atol=1e-12)
    np.testing.assert_allclose(points.min(axis=0), -half, atol=1e-12)


def test_the_corner_that_an_l_carton_leaves_out_is_none_of_its_own() -> None:
    drawn = load_scenario("l_carton").drawn(0)
    x, y, z = np.array(drawn.box.size_m) / 2
    nearest = np.linalg.norm(corners(drawn) - [x, y, z], axis=1).min()
    assert nearest > 0.05
