"""`preshape plan`: what it prints is the plan, as JSON, table and picture; without a plan it says why and exits 1."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image

from preshape.hal.object_shape import primitives
from preshape.hal.transform import transform
from preshape.planner.parts import l_carton_parts
from preshape.tools import cli
from preshape.tools.bench_plan import bench_plan
from preshape.tools.plan_report import TaskPlanReport


def plan_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    code = cli.run_command(["plan", "--json", *arguments])
    printed = capsys.readouterr().out
    msgspec.json.decode(printed, type=TaskPlanReport, strict=True)
    return code, json.loads(printed)


def test_json_holds_the_contracted_figures(capsys: pytest.CaptureFixture[str]) -> None:
    code, plan = plan_json(capsys, "--seed", "1")
    assert code == 0
    assert plan["schema"] == "preshape/plan/1"
    assert plan["priorities"] == {"r": [2, 2, 2, 1, 1], "l": [None, None, 3, 3, 3], "c": [None, 1, None, None, None]}
    areas = {(a["resource"], tuple(a["tasks"])): a for a in plan["areas"]}
    assert set(areas) == {("r", (1, 2, 3)), ("c", (2,)), ("l", (3, 4, 5)), ("r", (4,)), ("r", (5,))}
    assert areas["r", (1, 2, 3)]["parts"] == 2
    assert len(areas["r", (1, 2, 3)]["components"]) == 12
    right, left = plan["grasps"]
    assert (right["hand"], left["hand"]) == ("right", "left")
    for grasp in (right, left):
        chosen = grasp["chosen"]
        assert chosen["qp_residual_mm"] < 0.5
        assert len(chosen["fingertips_m"]) == len(chosen["fingers"])
        assert len(chosen["joints_rad"]) == 13
        assert all(edge > 0 for edge in chosen["preshaping_box"]["size_m"])
        assert np.linalg.det(chosen["palm"]["rotation"]) == pytest.approx(1.0)
    assert {"before", "after"} <= set(plan["time_ms"])


def test_palms_on_end_caps_only_leave_four_components(capsys: pytest.CaptureFixture[str]) -> None:
    code, plan = plan_json(capsys, "--palm-on-end-caps-only")
    assert code == 0
    assert len(plan["components"]["right hand, tasks 1-3"]) == 4


def test_literal_reading_has_one_component_or_names_the_cause(capsys: pytest.CaptureFixture[str]) -> None:
    code, plan = plan_json(capsys, "--reading", "literal")
    left = plan["components"]["left hand, tasks 3-5"]
    if code == 0:
        assert len(left) == 1
        assert left[0].startswith("section 1")
    else:
        assert code == 1
        assert "left hand" in plan["certificate"]


def test_scene_without_a_plan_exits_1_with_its_certificate(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["plan", "--set", "box.size_m=[0.3,0.32,0.5]", "--set", "table.x_m=[0.15,1.5]"]
    assert cli.run_command(arguments) == 1
    printed = " ".join(capsys.readouterr().out.split())
    assert "no plan: right hand" in printed
    assert "beyond the hand's span" in printed


@pytest.mark.parametrize("scenario", ["l_carton", "cylinder"])
def test_objects_that_are_no_boxes_are_planned_part_by_part(
    scenario: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    picture = tmp_path / "plan.png"
    code, plan = plan_json(capsys, "--scenario", scenario, "--picture", str(picture))
    assert code == 0
    names = [part["name"] for part in plan["parts"]]
    assert names == (["upright", "foot"] if scenario == "l_carton" else ["cylinder"])
    assert all(part["areas"] for part in plan["parts"])
    assert plan["grasps"][0]["chosen"]["part"] in names
    with Image.open(picture) as drawn:
        pixels = np.asarray(drawn)
    assert len(np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)) > 100


def test_table_shows_priorities_and_both_hands(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run_command(["plan"]) == 0
    printed = capsys.readouterr().out
    for text in ("priorities, eq. (3)", "right hand, tasks 1-3", "left hand, tasks 3-5", "force closure", "time:"):
        assert text in printed


@pytest.mark.parametrize(
    ("arguments", "field"),
    [(["--seed", "-1"], "seed"), (["--picture", "a.jpg"], "picture"), (["--scenario", "nowhere"], "scenario")],
)
def test_bad_option_exits_2_and_names_it(arguments: list[str], field: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run_command(["plan", *arguments]) == 2
    assert f"--{field}" in capsys.readouterr().err


def test_l_carton_of_primitives_is_the_planners() -> None:
    size = (0.15, 0.08, 0.20)
    upright, foot = primitives("l_carton", size)
    expected = l_carton_parts(size, float(upright.size[0]))
    for primitive, part in zip((upright, foot), expected, strict=True):
        corners = part.vertices - primitive.X_object_part[:3, 3]
        assert np.allclose(np.ptp(corners, axis=0), primitive.size)
        assert np.allclose(corners.max(axis=0), primitive.size / 2)


def test_primitives_lie_within_the_outer_size_about_its_centre() -> None:
    for shape in ("box", "l_carton", "cylinder"):
        size = np.array([0.08, 0.08, 0.2])
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for primitive in primitives(shape, (0.08, 0.08, 0.2)):
            low = np.minimum(low, primitive.X_object_part[:3, 3] - primitive.size / 2)
            high = np.maximum(high, primitive.X_object_part[:3, 3] + primitive.size / 2)
            assert np.allclose(primitive.X_object_part[:3, :3], transform()[:3, :3])
        assert np.allclose(high, size / 2)
        assert np.allclose(low, -size / 2)
    with pytest.raises(ValueError, match=r"box\.size_m"):
        primitives("cylinder", (0.07, 0.08, 0.2))


def test_bench_counts_plans_and_times() -> None:
    figures = bench_plan(6)
    assert figures["plans"] == 6
    assert 0 < figures["before_median_ms"] <= figures["before_p99_ms"] <= figures["before_max_ms"]
    assert figures["without_plan"] < 6
