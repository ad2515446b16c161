"""The doctor: demands by hand and by a slow simulation, capacity beside them, facts about the machine."""

import json
import tomllib
from importlib import metadata
from pathlib import Path

import msgspec
import numpy as np
import pytest

from preshape.control.opening_motion import TIP_X
from preshape.sim_backend.scenario import BoxSection, Scenario
from preshape.tools import holding_check as holding_check_module
from preshape.tools import machine
from preshape.tools.command_doctor import Options, execute
from preshape.tools.configuration import load_scenario
from preshape.tools.holding_check import FRICTIONS, SCALES, Holding, holding_check
from preshape.tools.opening_demand import crease_moment, demands, hardest_tear

TEA_BOX = Scenario(name="tea")


def _with_scale(scale: float) -> Scenario:
    return msgspec.structs.replace(TEA_BOX, strengths=msgspec.structs.replace(TEA_BOX.strengths, scale=scale))


@pytest.mark.parametrize("seed", range(10))
def test_the_hardest_tear_is_the_moment_at_which_a_slowly_pulled_lid_is_all_torn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arms, strength = rng.uniform(0.005, 0.09, rng.integers(1, 15)), 0.5
    intact, moment, step = arms.copy(), 0.0, 1e-5
    while len(intact):
        moment += step
        while len(intact) and (moment * intact / (intact @ intact)).max() > strength:
            loads = moment * intact / (intact @ intact)
            intact = intact[loads <= strength]
    assert hardest_tear(arms, strength) == pytest.approx(moment, abs=2 * step)


def test_points_at_one_distance_tear_together() -> None:
    assert hardest_tear(np.full(4, 0.09), 0.5) == pytest.approx(4 * 0.5 * 0.09)


def test_the_tab_asks_for_its_strength_times_the_lever_arms() -> None:
    push = demands(TEA_BOX)[0]
    s, depth = TEA_BOX.strengths, TEA_BOX.opening.tab_depth_m
    # A force of -1 N along x at height y turns about z by y: where the thumb is; the tab's hinge lies inside the edge.
    arm = push.wrench[5] - (TEA_BOX.box.size_m[1] / 2 - depth)
    assert arm == pytest.approx(depth / 2 + TIP_X)
    assert push.newton == pytest.approx((s.tab_n * depth + crease_moment(s) / 2) / arm)


@pytest.mark.parametrize("face", ["+x", "-x"])
def test_a_push_goes_into_the_opening_face_a_pull_out_of_it_and_a_lever_is_a_couple(face: str) -> None:
    opening = msgspec.structs.replace(TEA_BOX.opening, face=face)
    push, pull, lever = demands(msgspec.structs.replace(TEA_BOX, opening=opening))
    outward = np.array([1.0 if face == "+x" else -1.0, 0.0, 0.0])
    assert push.wrench[:3] == pytest.approx(-outward)
    assert pull.wrench[:3] == pytest.approx(outward)
    assert lever.wrench[:3] == pytest.approx(np.zeros(3))
    assert np.linalg.norm(lever.wrench[3:]) == pytest.approx(TEA_BOX.opening.tab_depth_m)


def test_demands_grow_with_the_strengths() -> None:
    once, twice = demands(TEA_BOX), demands(_with_scale(2.0))
    assert [b.newton for b in twice] == pytest.approx([2 * a.newton for a in once])


@pytest.fixture(scope="module")
def holdings() -> list[Holding]:
    return holding_check(TEA_BOX)


def test_every_load_is_checked_at_every_friction_and_strength(holdings: list[Holding]) -> None:
    assert len({(row.load, row.friction, row.scale) for row in holdings}) == 3 * len(FRICTIONS) * len(SCALES)


def test_friction_and_torque_never_weaken_the_grip(holdings: list[Holding]) -> None:
    for row in holdings:
        assert row.limit_n >= row.held_n - 1e-6
        rougher = [r for r in holdings if (r.load, r.scale) == (row.load, row.scale) and r.friction > row.friction]
        assert all(other.held_n >= row.held_n - 1e-3 for other in rougher)


@pytest.mark.parametrize(("held", "limit", "verdict"), [(2.0, 3.0, "holds"), (1.0, 2.0, "at limits"), (0.5, 1.0, "no")])
def test_the_verdict_compares_with_what_is_asked(held: float, limit: float, verdict: str) -> None:
    assert Holding("push", 0.5, 1.0, 1.5, held, limit).verdict == verdict


def test_every_required_package_is_listed_with_its_version() -> None:
    needed = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]["dependencies"]
    listed = machine.packages()
    for requirement in needed:
        name = requirement.split(">")[0].split("=")[0]
        assert listed[name] == metadata.version(name)


def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(holding_check_module, "FRICTIONS", (0.6,))
    monkeypatch.setattr(holding_check_module, "SCALES", (1.0,))
    monkeypatch.setattr(machine, "_CALM_S", 0.01)


def test_json_and_tables_tell_the_same(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    _quick(monkeypatch)
    assert execute(Options(json=True)) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["packages"]["numpy"] == metadata.version("numpy")
    row = next(row for row in found["holding"] if (row["load"], row["friction"], row["scale"]) == ("push", 0.6, 1.0))
    assert row["demand_n"] == pytest.approx(demands(load_scenario("tea_box"))[0].newton)
    assert execute(Options()) == 0
    assert f"{row['held_n']:.1f} / {row['limit_n']:.1f}" in capsys.readouterr().out


def test_a_box_that_no_grip_suits_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    _quick(monkeypatch)
    narrow = msgspec.structs.replace(TEA_BOX, box=BoxSection(size_m=(0.06, 0.05, 0.20)))
    monkeypatch.setattr("preshape.tools.configuration.load_scenario", lambda name, overrides: narrow)
    assert execute(Options()) == 1
    assert "no grip holds the box of tea" in capsys.readouterr().out


def test_a_missing_package_is_shown_and_told_by_the_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _quick(monkeypatch)
    monkeypatch.setattr(metadata, "requires", lambda name: ["numpy", "no-such-package>=2; python_version > '3'"])
    assert execute(Options()) == 1
    assert "missing" in capsys.readouterr().out
