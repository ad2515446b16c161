"""Laws of the live dashboard: what is drawn is what was published, and nothing listens beyond this machine."""

from __future__ import annotations

import socket
import time
from pathlib import Path

import numpy as np
import pytest
from test_tick_record import filled
from zenoh_robot import client, free_endpoint, until

from preshape.control.observer import Observers
from preshape.hal import tick_record as tr
from preshape.hal.answers import ImageAnswer, ObstaclesAnswer
from preshape.hal.device import DeviceUnreachable
from preshape.hal.transform import exp_so3, rotation_xyzw, transform
from preshape.hal.world import Opening, OrientedBox
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import nominal_box, workcell
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.dash_live import LiveDash
from preshape.tools.rerun_layout import blueprint
from preshape.tools.rerun_stream import RerunStream
from preshape.tools.rerun_viewer import LOOPBACK, RerunViewer, free_port
from preshape.tools.telemetry import Telemetry
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.telemetry_keys import Keys
from preshape.tools.telemetry_listener import TelemetryListener
from preshape.tools.telemetry_messages import decode_message, encode_message
from preshape.tools.telemetry_records import RecordBuilder
from preshape.tools.telemetry_scene import scene_info, surroundings
from preshape.tools.telemetry_streams import StateStreams
from preshape.tools.urdf_bases import arm_bases

CELL, BOX = workcell(Scenario(name="test")), nominal_box(Scenario(name="test"))
DRAWN = (
    "position", "velocity", "torque", "target", "torque_limit", "stamp_ns", "task", "phase", "mode", "status", "fault",
    "group_distance", "group_point", "group_force", "X_world_preshape", "preshape_half", "tip_target",
    "X_world_object", "object_stamp_ns", "now_ns", "tick", "held",
)  # fmt: skip
"""What a viewer draws of a record."""


def records_of(count: int) -> tr.TickRecord:
    """Return random records, without an object, an opening or aims at first."""
    rng, record, kept = np.random.default_rng(2), tr.new_record(), []
    for tick in range(count):
        filled(record, tick, rng, f"phase {tick // 7}")
        if tick < 3:
            tr.note_progress(record, 1, "look", "", None)
            tr.note_field(record, np.nan, np.nan, np.nan)
        kept.append(record.copy())
    return np.array(kept)


def test_records_put_together_from_messages_are_those_that_were_published() -> None:
    records, builder = records_of(20), RecordBuilder()
    streams = StateStreams(dict.fromkeys(TelemetryConfig().rates(), 1000.0), 0)
    for record in records:
        for _, message in streams.messages(record):
            builder.add(decode_message(encode_message(message)))
    again = builder.records()
    assert len(again) == 19, "the last one may not be complete"
    for name in DRAWN:
        wanted, got = records[name][:19], again[name]
        close = np.allclose(got, wanted, atol=1e-9, equal_nan=True) if wanted.dtype.kind == "f" else (got == wanted)
        assert np.all(close), name


def test_a_run_whose_clock_begins_anew_is_a_new_run() -> None:
    records, builder = records_of(20), RecordBuilder()
    again = records[:5].copy()
    again["now_ns"] -= 10**11
    for block in (records[10:], again):
        streams = StateStreams(dict.fromkeys(TelemetryConfig().rates(), 1000.0), 0)
        for record in block:
            for _, message in streams.messages(record):
                builder.add(message)
    assert builder.records()["tick"].tolist() == [*range(10, 19), *range(0, 4)]


def test_surroundings_are_those_that_were_told() -> None:
    from preshape.hal.description import robot_urdf

    info = decode_message(encode_message(scene_info(CELL, BOX)))
    cell, box = surroundings(info, arm_bases(robot_urdf(CELL.X_world_base)))
    assert np.allclose(box.size, BOX.size) and box.candidate_faces == BOX.candidate_faces
    assert box.tab_size == pytest.approx(BOX.tab_size)
    assert [static.name for static in cell.statics] == [static.name for static in CELL.statics]
    for mine, theirs in zip(cell.statics, CELL.statics, strict=True):
        assert np.allclose(mine.X_world_box, theirs.X_world_box) and np.allclose(mine.half, theirs.half)
    assert np.allclose(cell.camera.X_world_camera, CELL.camera.X_world_camera)
    assert (cell.camera.focal_px, cell.camera.width) == (CELL.camera.focal_px, CELL.camera.width)
    assert all(np.allclose(cell.X_world_base[side], CELL.X_world_base[side]) for side in ("right", "left"))


def test_a_quaternion_of_any_length_is_a_rotation() -> None:
    R = rotation_xyzw(3.0 * np.array([0.1, -0.4, 0.2, 0.7]))
    assert np.allclose(R @ R.T, np.eye(3)) and np.isclose(np.linalg.det(R), 1.0)
    with pytest.raises(ValueError, match="quaternion"):
        rotation_xyzw((0.0, 0.0, 0.0, 0.0))


@pytest.mark.slow
def test_a_robot_is_drawn_as_it_publishes(tmp_path: Path) -> None:
    endpoint, path = free_endpoint(), tmp_path / "live.rrd"
    config = TelemetryConfig(endpoint=endpoint, heartbeat_hz=20.0)
    with Telemetry(config, "fake", False, 500.0, CELL.X_world_base, scene_info(CELL, BOX)) as telemetry:
        watching, records = Observers(), records_of(60)
        telemetry.watch(type("Loop", (), {"request_stop": lambda self, reason: None})(), watching)
        telemetry.hear(ObstaclesAnswer(call=0, now_ns=int(records["now_ns"][0]), obstacles=()), None)
        for record in records[:20]:
            watching.notify(record)
        with client(endpoint) as session:
            dash = LiveDash(TelemetryListener(session, Keys()), RerunStream.to_file(path, blueprint(live=True)))
            X_pillar = transform((0.3, 0.1, 0.2), exp_so3(np.array([0.0, 0.0, 1.0])))
            pillar = OrientedBox("pillar", X_pillar, np.full(3, 0.1))
            telemetry.hear(ObstaclesAnswer(call=1, now_ns=int(records["now_ns"][20]), obstacles=(pillar,)), None)
            image = ImageAnswer(call=0, now_ns=int(records["now_ns"][20]), stamp_ns=0, model=CELL.camera)
            telemetry.hear(image, np.zeros((30, 40), np.uint8))
            for record in records[20:]:
                tr.note_opening(record, Opening("+x", "-y", 0.01))
                watching.notify(record)
                time.sleep(0.002)
            assert until(lambda: (dash.turn(), dash.messages > 60)[1])
            time.sleep(0.3)
            dash.close()
    assert not watching.failures
    from test_rerun_recording import columns_of

    entities = columns_of(path)
    wanted = {"/world/obstacles/pillar", "/world/camera/image", "/world/object/tab", "/world/joints", "/events"}
    wanted |= {"/loop/timing", "/loop/age", "/right/torque_ratio", "/left/distance", "/task", "/world/aim/left_tips"}
    assert wanted <= set(entities)


def test_no_robot_is_named(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with Telemetry(TelemetryConfig(endpoint=endpoint), "fake", True, 500.0), client(endpoint) as session:
        with pytest.raises(DeviceUnreachable, match="preshape/other"):
            TelemetryListener(session, Keys("other"))


def listening(port: int) -> set[str]:
    """Return the addresses of this machine at which somebody listens on a port."""
    addresses: set[str] = set()
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        local, state = line.split()[1], line.split()[3]
        address, at = local.split(":")
        if state == "0A" and int(at, 16) == port:
            addresses.add(socket.inet_ntoa(int(address, 16).to_bytes(4, "little")))
    return addresses | {
        line.split()[1]
        for line in Path("/proc/net/tcp6").read_text().splitlines()[1:]
        if line.split()[3] == "0A" and int(line.split()[1].rsplit(":", 1)[1], 16) == port
    }


@pytest.mark.slow
def test_the_viewer_listens_on_this_machine_only_and_leaves_nothing_behind() -> None:
    port, web_port = free_port(), free_port()
    with RerunViewer(True, (), port, web_port) as viewer:
        assert viewer.running and f"{LOOPBACK}:{web_port}" in viewer.page
        assert listening(port) == listening(web_port) == {LOOPBACK}
    with socket.socket() as probe:
        assert probe.connect_ex((LOOPBACK, port)) != 0


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    from preshape.tools.command_dash import Options, execute

    for path in (tmp_path, tmp_path / "missing.rrd", Path(__file__)):
        with pytest.raises(ConfigurationError, match="allowed are|without recording"):
            execute(Options(recording=path))
    with pytest.raises(ConfigurationError, match="--port"):
        Options(port=70000)
