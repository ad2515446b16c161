"""Laws of the recording: what is in the file is what was recorded."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from preshape.hal import tick_record as tr
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState
from preshape.hal.transform import exp_so3, transform
from preshape.hal.world import NominalBox, OrientedBox, PoseSample, Workcell
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import nominal_box, workcell
from preshape.tools import series
from preshape.tools.rerun_recording import RerunRecording

TICKS = 60
Chunk = tuple[list[float], dict[str, list[Any]]]


def surroundings() -> tuple[Workcell, NominalBox]:
    """Return the default workcell and box."""
    scenario = Scenario(name="test")
    return workcell(scenario), nominal_box(scenario)


def recorded(path: Path) -> tr.TickRecord:
    """Write a short recording and return the records that went into it."""
    recording, record, rng = RerunRecording(*surroundings(), interval_s=0.0), tr.new_record(), np.random.default_rng(0)
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
        recording.notify(record)
        kept.append(record.copy())
    recording.write(path)
    return np.array(kept)


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
    entities, records = columns_of(recording[0]), recording[1]

    def pose(link: str, row: int) -> np.ndarray:
        path = f"/world/robot/{link}"
        p = np.array(timed(entities, path, "Transform3D:translation")[1][row])[0]
        R = np.array(timed(entities, path, "Transform3D:mat3x3")[1][row])[0].reshape(3, 3).T  # stored by columns
        return transform(p, R)

    for side in ("right", "left"):
        hand = LAYOUT.hand(side)
        X_palm_part = hand_kinematics(side).part_poses(records["position"][0, hand])
        X_world_palm = pose(f"{side}_palm", 0)
        assert np.allclose(pose(f"{side}_ring_dist", 0), X_world_palm @ X_palm_part[-1], atol=1e-5)


def test_object_is_drawn_where_it_was_believed_to_be(recording: tuple[Path, tr.TickRecord]) -> None:
    entities, records = columns_of(recording[0]), recording[1]
    times, p = timed(entities, "/world/object", "Transform3D:translation")
    assert times.min() >= 0.02 - 1e-9, "nothing is drawn before the first estimate"
    row = round(times[0] / 0.002)
    R = np.array(timed(entities, "/world/object", "Transform3D:mat3x3")[1][0])[0].reshape(3, 3).T  # stored by columns
    assert np.allclose(transform(np.array(p[0])[0], R), records["X_world_object"][row], atol=1e-6)


def test_recording_of_nothing_is_refused(tmp_path: Path) -> None:
    cell, box = surroundings()
    cell = Workcell(cell.X_world_base, (OrientedBox("table", np.eye(4), np.ones(3)),), cell.camera)
    with pytest.raises(ValueError, match="at least one record"):
        RerunRecording(cell, box).write(tmp_path / "recording.rrd")


def test_torque_ratio_is_one_at_the_limit() -> None:
    records = np.zeros(3, tr.TICK)
    joints = LAYOUT.finger("left", "fore")
    records["torque"][1, joints] = -LAYOUT.torque[joints]
    ratio = series.torque_ratios(records, "left")
    assert ratio.names[1] == "fore"
    assert ratio.values[1].tolist() == [0.0, 1.0, 0.0, 0.0, 0.0]
