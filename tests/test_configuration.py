"""Laws of scenario files: what is refused, and that the message names file, field, value and what is allowed."""

from __future__ import annotations

import tomllib
from pathlib import Path

import msgspec
import numpy as np
import pytest

from preshape.hal.world import Face, NominalBox
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import initial_box_pose, nominal_box, workcell
from preshape.tools.configuration import load_scenario, shipped_scenarios
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.feasibility import impossibility

OBSTACLE = "[[obstacles]]\nname = 'a'\nsize_m = [0.1, 0.1, 0.1]\nposition_m = [0, 0, 0.5]\n"
BAD_FIELDS = [
    ("[box]\nfricton = 0.5", "box.fricton", "unknown key", "friction"),
    ("colour = 1", "colour", "unknown key", "opening"),
    ("[box]\nfriction = 'rough'", "box.friction", "'rough'", "a number > 0 and <= 2"),
    ("[box]\nfriction = 2.5", "box.friction", "2.5", "a number > 0 and <= 2"),
    ("[box]\nfriction = nan", "box.friction", "nan", "a number > 0"),
    ("[box]\nyaw_deg = inf", "box.yaw_deg", "inf", "finite"),
    ("[box]\nsize_m = [0.06, -0.09, 0.2]", "box.size_m[1]", "-0.09", "a number > 0 and <= 2"),
    ("[box]\nsize_m = [0.06, 0.09]", "box.size_m", "[0.06, 0.09]", "3 values"),
    ("box = 3", "box", "3", "a table with size_m"),
    ("[strengths]\npoints = 2", "strengths.points", "2", "a whole number >= 3 and <= 60"),
    ("[strengths]\npoints = 12.5", "strengths.points", "12.5", "a whole number"),
    ("[draw]\nedges = 'yes'", "draw.edges", "'yes'", "true or false"),
    ("shape = 'ball'", "shape", "'ball'", "cylinder"),
    ("shape = 'cylinder'", "box.size_m[1]", "0.09", "0.06: a cylinder"),
    ("[[obstacles]]\nname = 'a'\nsize_m = [1, 1, 9]\nposition_m = [0, 0, 0]", "obstacles[0].size_m[2]", "9", "<= 2"),
    ("[[obstacles]]\nsize_m = [1, 1, 1]\nposition_m = [0, 0, 0]", "obstacles[0].name", "missing", ""),
    ("[opening]\nface = '+z'", "opening.face", "+z", "+x, -x, +y, -y"),
    ("[opening]\ncandidate_faces = ['+x', '-z']", "opening.candidate_faces[1]", "-z", "+x, -x, +y, -y"),
    ("[draw]\nfaces = ['+z']", "draw.faces[0]", "+z", "+x, -x, +y, -y"),
    ("[draw]\nfaces = ['+y']", "draw.faces", "+y", "opening.candidate_faces: +x, -x"),
    ("[opening]\nedge = '-x'", "opening.edge", "-x", "+y, -y"),
    ("[opening]\noffset_m = 0.09", "opening.offset_m", "0.09", "-0.0775 .. 0.0775"),
    ("[draw]\noffset_m = 0.09", "draw.offset_m", "0.09", "<= 0.0775"),
    ("[opening]\ntab_depth_m = 0.1", "opening.tab_depth_m", "0.1", "< 0.09"),
    ("[opening]\ntab_length_m = 0.3", "opening.tab_length_m", "0.3", "<= 0.2"),
    ("[draw]\nfriction = [0.8, 0.5]", "draw.friction", "[0.8, 0.5]", "low <= high"),
    ("[draw]\nmass_kg = [0.0, 0.5]", "draw.mass_kg", "[0, 0.5]", "0 < low"),
    ("[table]\nx_m = [0.9, 0.1]", "table.x_m", "[0.9, 0.1]", "low <= high"),
    ("[box]\nposition_m = [0.5, 0.7]", "box.position_m[1]", "0.7", "-0.6 .. 0.6"),
    ("[box]\ncenter_of_mass_m = [0, 0, 0.2]", "box.center_of_mass_m[2]", "0.2", "-0.1 .. 0.1"),
    ("[[disturbances.frozen]]\npart = 'right_toe'", "disturbances.frozen[0].part", "'right_toe'", "right_thumb"),
    ("[[disturbances.frozen]]\nfrom_s = 1.0", "disturbances.frozen[0].part", "missing", ""),
    ("[draw]\nfrozen_parts = ['thumb']", "draw.frozen_parts[0]", "'thumb'", "left_ring"),
    ("[draw]\nfrozen_from_s = [3.0, 1.0]", "draw.frozen_from_s", "[3, 1]", "0 <= low <= high"),
    ("[draw]\nappears_s = [-1.0, 1.0]", "draw.appears_s", "[-1, 1]", "0 <= low <= high"),
    ("[disturbances]\nkick_delay_s = [0.5, 0.1]", "disturbances.kick_delay_s", "[0.5, 0.1]", "0 <= low <= high"),
    ("[disturbances]\nkick_tasks = [6]", "disturbances.kick_tasks[0]", "6", ">= 1 and <= 5"),
    (OBSTACLE + "origin = 'hand'", "obstacles[0].origin", "'hand'", "one of box, world"),
    (OBSTACLE + "velocity_m_per_s = [0.1, 0.0]", "obstacles[0].velocity_m_per_s", "[0.1, 0.0]", "3 values"),
    ("[camera]\nlook_at_m = [0.05, 0.0, 0.1]", "camera.look_at_m", "[0.05, 0.0, 0.1]", "not straight"),
]


def refusal(name: str, overrides: tuple[str, ...] = ()) -> str:
    with pytest.raises(ConfigurationError) as caught:
        load_scenario(name, overrides)
    return str(caught.value)


@pytest.mark.parametrize(("text", "field", "value", "allowed"), BAD_FIELDS)
def test_a_bad_field_is_named_with_file_value_and_what_is_allowed(
    tmp_path: Path, text: str, field: str, value: str, allowed: str
) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(f"name = 'bad'\n{text}\n")
    message = refusal(str(file))
    assert message.startswith(f"{file}: {field}: ")
    assert value in message
    assert allowed in message
    assert "\n" not in message


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "broken.toml").write_text("[box\nfriction = 1")
    for name, cause in (("missing", "No such file"), ("binary", "not text"), ("broken", "not TOML")):
        message = refusal(str(tmp_path / f"{name}.toml"))
        assert f"{name}.toml: " in message and cause in message
    assert "directory" in refusal(str(tmp_path))
    assert "tea_box_lying" in refusal("no_such_scenario")


@pytest.mark.parametrize("name", sorted(shipped_scenarios()))
def test_shipped_scenarios_load_by_name_and_by_path_and_can_be_done(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario == load_scenario(str(shipped_scenarios()[name]))
    assert scenario.name == name
    drawn = scenario.drawn(3)
    assert impossibility(workcell(drawn), nominal_box(drawn), initial_box_pose(drawn)) is None


def test_an_override_sets_a_field_and_drops_what_would_draw_over_it() -> None:
    scenario = load_scenario("tea_box", ("box.friction=0.4", "opening.face=-x", "box.size_m.2=0.21"))
    assert scenario.box.size_m == (0.06, 0.09, 0.21)
    for seed in range(5):
        drawn = scenario.drawn(seed)
        assert drawn.box.friction == 0.4
        assert drawn.opening.face == "-x"
    kept = load_scenario("tea_box", ("box.friction=0.4", "draw.friction=[0.7, 0.8]"))
    assert 0.7 <= kept.drawn(0).box.friction <= 0.8


def test_a_seed_draws_obstacles_and_frozen_sensors_and_what_it_drew_before_stays(tmp_path: Path) -> None:
    file = tmp_path / "faulty.toml"
    file.write_text(
        "name = 'faulty'\n" + OBSTACLE + "origin = 'box'\n[draw]\nposition_m = 0.05\nobstacle_m = 0.02\n"
        "appears_s = [1.0, 2.0]\nfrozen_parts = ['left_fore', 'right_thumb_pip']\nfrozen_from_s = [3.0, 5.0]\n"
    )
    scenario = load_scenario(str(file))
    parts: set[str] = set()
    for seed in range(30):
        drawn, plain = scenario.drawn(seed), load_scenario("tea_box").drawn(seed)
        assert drawn.box.position_m == plain.box.position_m
        (obstacle,), (frozen,) = drawn.obstacles, drawn.disturbances.frozen
        place = [obstacle.position_m[k] - (*drawn.box.position_m, 0.5)[k] for k in range(3)]
        assert max(map(abs, place)) <= 0.02 and obstacle.origin == "world"
        assert 1.0 <= obstacle.appears_s <= 2.0 and 3.0 <= frozen.from_s <= 5.0
        assert drawn.drawn(seed + 1).obstacles == drawn.obstacles, "what is drawn is drawn once"
        parts.add(frozen.part)
    assert parts == {"left_fore", "right_thumb_pip"}


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("box.friction", ("TABLE.FIELD=VALUE",)),
        ("=3", ("TABLE.FIELD=VALUE",)),
        ("box..friction=1", ("TABLE.FIELD=VALUE",)),
        ("box.frction=1", ("box.frction", "unknown key", "friction")),
        ("box.friction=high", ("box.friction", "'high'", "a number")),
        ("box.friction=-1", ("box.friction", "-1", "> 0")),
        ("box.size_m.7=1", ("box.size_m.7", "0 .. 2")),
        ("name.x=1", ("name.x", "no table")),
        ("box=1", ("box", "a table with")),
    ],
)
def test_a_bad_override_is_named(override: str, words: tuple[str, ...]) -> None:
    message = refusal("tea_box", (override,))
    assert all(word in message for word in words)


def test_every_field_of_a_shipped_scenario_survives_a_round_trip(tmp_path: Path) -> None:
    scenario = load_scenario("tea_box")
    tables = tomllib.loads(shipped_scenarios()["tea_box"].read_text())
    assert msgspec.convert(msgspec.to_builtins(scenario), Scenario) == scenario
    assert scenario.box.size_m == tuple(tables["box"]["size_m"])


@pytest.mark.parametrize(
    ("candidates", "closed"),
    [(("+x", "-x"), {"+y", "-y"}), (("+y",), {"+x", "-x", "-y"}), ((), {"+x", "-x", "+y", "-y"})],
)
def test_a_side_that_may_open_is_not_closed_and_an_end_cap_is_no_side(
    candidates: tuple[Face, ...], closed: set[Face]
) -> None:
    box = NominalBox(np.array([0.06, 0.09, 0.20]), candidates)
    assert set(box.closed_sides) == closed


@pytest.mark.parametrize(
    ("overrides", "task", "cause"),
    [
        (("box.size_m=[0.25, 0.25, 0.4]",), 1, "no span"),
        (
            ('opening.candidate_faces=["+y", "-y"]', 'draw.faces=["+y"]', "opening.face=+y", "opening.edge=+x"),
            1,
            "no span: fingers on +x: width between thumb and middle finger: got 0.06 m, allowed is 0.07 .. 0.1 m",
        ),
        (("box.position_m=[0.9, 0.5]", "draw.position_m=0.0"), 1, "unreachable: the right hand"),
        (("arms.right_base_m=[-2.0, -1.0, 0.0]",), 1, "unreachable: the right hand"),
        (("arms.left_base_m=[-2.0, 1.0, 0.0]",), 3, "unreachable: the left hand"),
    ],
)
def test_what_nobody_can_do_is_named_with_its_task(overrides: tuple[str, ...], task: int, cause: str) -> None:
    drawn = load_scenario("tea_box", overrides).drawn(0)
    found = impossibility(workcell(drawn), nominal_box(drawn), initial_box_pose(drawn))
    assert found is not None
    assert found[0] == task
    assert found[1].startswith(cause)
