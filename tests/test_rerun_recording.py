"""Laws of the recording: what is in the file is what was recorded."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from preshape.hal import tick_record as tr
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState
from preshape.hal.transform import exp_so3, rpy_matrix, transform
from preshape.hal.world import FACES, NominalBox, PoseSample, Workcell
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import nominal_box, workcell
from preshape.tools import series
from preshape.tools.display_urdf import display_urdf
from preshape.tools.rerun_content import RerunContent, Thinning
from preshape.tools.rerun_layout import blueprint
from preshape.tools.rerun_scene import opening_boxes
from preshape.tools.rerun_stream import RerunStream

TICKS = 60
Chunk = tuple[list[float], dict[str, list[Any]]]


def surroundings() -> tuple[Workcell, NominalBox]:
    """Return the default workcell and box."""
    scenario = Scenario(name="test")
    return workcell(scenario), nominal_box(scenario)


def recorded(path: Path) -> tr.TickRecord:
    """Write a short recording and return the records that went into it."""
    record, rng = tr.new_record(), np.random.default_rng(0)
    kept = []
    for tick in range(TICKS):
        now_ns = 5 * 10**9 + tick * 2_000_000
        position = rng.uniform(LAYOUT.lower, LAYOUT.upper)
        faulty = tick >= 50
        state = RobotState(
            tick, position, 0 * position, rng.normal(size=LAYOUT.dof), np.full(LAYOUT.dof, now_ns - 300_000),
            DeviceStatus.FAULT if faulty else DeviceStatus.ARMED, "node 3 lost" if faulty else "",
        )  # fmt: skip
        command = RobotCommand(tick + 1, Mode.POSITION, position + 0.01, LAYOUT.torque)
        sample = None if tick < 10 else PoseSample(now_ns, transform(rng.normal(size=3), exp_so3(rng.normal(size=3))))
        tr.note_state(record, tick, now_ns, state)
        tr.note_command(record, command, not faulty)
        tr.note_progress(record, 1 + tick // 30, "approach", "track", sample)
        tr.note_field(record, rng.uniform(size=(2, 3)), rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 3, 3)))
        tr.note_timing(record, 1000 * tick, 400_000)
        kept.append(record.copy())
    records = np.array(kept)
    path.parent.mkdir()
    content = RerunContent(RerunStream.to_file(path, blueprint()), *surroundings(), plot_s=0.002, motion_s=0.002)
    for block in np.split(records, [7, 8, 33]):
        content.add_ticks(block)
        content.flush()
    content.close()
    return records


def columns_of(path: Path) -> dict[str, list[Chunk]]:
    """Return, for each entity, its chunks as (seconds, component -> rows)."""
    from rerun.chunk import RrdReader

    entities: dict[str, list[Chunk]] = {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        rows = {name: batch.column(name).to_pylist() for name in batch.schema.names}
        seconds = [] if chunk.is_static else (batch.column("time").cast("int64").to_numpy() * 1e-9).tolist()
        entities.setdefault(chunk.entity_path, []).append((seconds, rows))
    return entities


def timed(entities: dict[str, list[Chunk]], path: str, component: str) -> tuple[np.ndarray, list[Any]]:
    """Return the times and rows of one component of one entity."""
    chunks = [(seconds, rows[component]) for seconds, rows in entities[path] if seconds and component in rows]
    times = np.concatenate([seconds for seconds, _ in chunks])
    return times, [row for _, rows in chunks for row in rows]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tr.TickRecord]:
    """Return a recording and the records in it."""
    path = tmp_path_factory.mktemp("run") / "deep" / "recording.rrd"
    return path, recorded(path)


def test_file_is_a_valid_recording(recording: tuple[Path, tr.TickRecord]) -> None:
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recording[0])]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "without error" in result.stdout + result.stderr


def test_plots_hold_the_recorded_numbers(recording: tuple[Path, tr.TickRecord]) -> None:
    entities, records = columns_of(recording[0]), recording[1]
    for wanted in series.record_series(records):
        times, rows = timed(entities, "/" + wanted.path, "Scalars:scalars")
        known = ~np.all(np.isnan(wanted.values), axis=1)
        assert np.allclose(times, np.arange(TICKS)[known] * 0.002)
        assert np.allclose(np.array(rows, float), wanted.values[known], equal_nan=True), wanted.path


def test_states_change_where_the_records_do(recording: tuple[Path, tr.TickRecord]) -> None:
    entities = columns_of(recording[0])
    assert timed(entities, "/task", "StateChange:state")[1] == [["task 1"], ["task 2"]]
    times, states = timed(entities, "/device", "StateChange:state")
    assert states == [["armed"], ["fault"]]
    assert np.allclose(times, [0.0, 0.1])


def test_faults_are_logged_as_errors(recording: tuple[Path, tr.TickRecord]) -> None:
    entities = columns_of(recording[0])
    texts = [row[0] for row in timed(entities, "/events", "TextLog:text")[1]]
    levels = [row[0] for row in timed(entities, "/events", "TextLog:level")[1]]
    assert levels == ["INFO", "INFO", "ERROR"]
    assert texts[-1] == "task 2: approach, track, device fault: node 3 lost"


def test_robot_is_drawn_where_its_joints_put_it(recording: tuple[Path, tr.TickRecord]) -> None:
    """Follow the frames from link to link, the fixed ones as the URDF says, the moving ones as they were sent."""
    entities, records = columns_of(recording[0]), recording[1]
    parent: dict[str, tuple[str, np.ndarray]] = {}
    for joint in ElementTree.fromstring(display_urdf(surroundings()[0].X_world_base)).iter("joint"):
        origin, names = joint.find("origin"), [joint.find(tag).get("link") for tag in ("child", "parent")]
        xyz, rpy = (np.array(origin.get(name).split(), float) for name in ("xyz", "rpy"))
        parent[names[0]] = (names[1], transform(xyz, rpy_matrix(tuple(rpy))))
    columns = [timed(entities, "/world/joints", f"Transform3D:{name}") for name in ("child_frame", "parent_frame")]
    times, p = timed(entities, "/world/joints", "Transform3D:translation")
    _, turns = timed(entities, "/world/joints", "Transform3D:quaternion")
    row = 30
    moved = 0
    for k in np.flatnonzero(np.isclose(times, row * 0.002)):
        child, above = (rows[k][0] for _, rows in columns)
        x, y, z, w = turns[k][0]
        theta = 2 * np.arctan2(np.linalg.norm([x, y, z]), w)
        axis = np.array([x, y, z]) / max(np.linalg.norm([x, y, z]), 1e-12)
        parent[child] = (above, transform(np.array(p[k][0]), exp_so3(theta * axis)))
        moved += 1
    assert moved == 48, "40 joints and 8 coupled ones move"

    def pose(link: str) -> np.ndarray:
        above, X = parent[link]
        return X if above == "world" else pose(above) @ X

    for side in ("right", "left"):
        X_palm_part = hand_kinematics(side).part_poses(records["position"][row, LAYOUT.hand(side)])
        X_world_palm = palm_pose(side, surroundings()[0].X_world_base[side], records["position"][row, LAYOUT.arm(side)])
        assert np.allclose(pose(f"{side}_palm"), X_world_palm, atol=1e-5)
        assert np.allclose(pose(f"{side}_ring_dist"), X_world_palm @ X_palm_part[-1], atol=1e-5)


def test_forces_stand_at_the_reciprocal_points(recording: tuple[Path, tr.TickRecord]) -> None:
    entities, records = columns_of(recording[0]), recording[1]
    times, origins = timed(entities, "/world/field/left_thumb/force", "Arrows3D:origins")
    assert np.allclose(times, np.arange(TICKS) * 0.002)
    assert np.allclose(np.array(origins)[:, 0], records["group_point"][:, 1, 1], atol=1e-6)
    vectors = np.array(timed(entities, "/world/field/left_thumb/force", "Arrows3D:vectors")[1])[:, 0]
    force = records["group_force"][:, 1, 1]
    assert np.allclose(np.cross(vectors, force), 0.0, atol=1e-5) and (np.sum(vectors * force, axis=1) > 0).all()


def test_lid_and_tab_lie_on_the_face_that_was_found() -> None:
    box = surroundings()[1]
    centers, halves = opening_boxes(box, FACES.index("+x"), FACES.index("-y"), 0.01)
    lid, tab = centers
    assert np.isclose(lid[0], box.size[0] / 2, atol=0.003) and np.allclose(lid[1:], 0.0)
    assert np.allclose(halves[0][1:], box.size[1:] / 2)
    assert np.isclose(tab[1] - halves[1][1], -box.size[1] / 2) and np.isclose(tab[2], 0.01)
    assert np.allclose(2 * halves[1][1:], box.tab_size[::-1])


def test_thinning_keeps_one_row_an_interval_however_the_rows_come() -> None:
    now_ns = np.arange(0, 10**9, 2_000_000)
    whole = Thinning(0.02).rows(now_ns)
    assert np.array_equal(now_ns[whole], np.arange(0, 10**9, 20_000_000))
    parts, thinning, start = [], Thinning(0.02), 0
    for block in np.split(now_ns, [1, 14, 15, 300]):
        parts += (start + thinning.rows(block)).tolist()
        start += len(block)
    assert parts == whole.tolist()


def test_object_is_drawn_where_it_was_believed_to_be(recording: tuple[Path, tr.TickRecord]) -> None:
    entities, records = columns_of(recording[0]), recording[1]
    times, p = timed(entities, "/world/object", "Transform3D:translation")
    assert times.min() >= 0.02 - 1e-9, "nothing is drawn before the first estimate"
    row = round(times[0] / 0.002)
    R = np.array(timed(entities, "/world/object", "Transform3D:mat3x3")[1][0])[0].reshape(3, 3).T  # stored by columns
    assert np.allclose(transform(np.array(p[0])[0], R), records["X_world_object"][row], atol=1e-6)


def test_torque_ratio_is_one_at_the_limit() -> None:
    records = np.zeros(3, tr.TICK)
    joints = LAYOUT.finger("left", "fore")
    records["torque"][1, joints] = -LAYOUT.torque[joints]
    ratio = series.torque_ratios(records, "left")
    assert ratio.names[1] == "fore"
    assert ratio.values[1].tolist() == [0.0, 1.0, 0.0, 0.0, 0.0]
