"""Laws of the messages: what a tick record says arrives whole, in JSON that its published schema describes."""

from __future__ import annotations

import json

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from preshape.control import box_opening
from preshape.hal import tick_record as tr
from preshape.hal.description import robot_urdf
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState
from preshape.hal.transform import exp_so3, quaternion_xyzw, transform
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.telemetry_events import EventFinder
from preshape.tools.telemetry_health import HealthMeter
from preshape.tools.telemetry_info import robot_info, schema_info
from preshape.tools.telemetry_keys import SCHEMAS, Keys, check_name, message_type
from preshape.tools.telemetry_messages import JointsState, ObjectState, TaskState, decode_message, encode_message
from preshape.tools.telemetry_states import STATES, Stamps, state_of

PERIOD_NS = 2_000_000


def record_of(tick: int, rng: np.random.Generator, **fields: object) -> tr.TickRecord:
    """Return a record of a random tick, some fields set."""
    record, now_ns = tr.new_record(), 10**12 + tick * PERIOD_NS
    position, velocity, torque = rng.normal(size=(3, LAYOUT.dof))
    stamps = np.full(LAYOUT.dof, now_ns - 500_000)
    tr.note_state(record, tick, now_ns, RobotState(tick, position, velocity, torque, stamps, DeviceStatus.ARMED))
    tr.note_command(record, RobotCommand(tick + 1, Mode.POSITION, position + 0.1, np.ones(LAYOUT.dof)), True)
    record["task"], record["phase"], record["mode"] = 1, b"approach", b"running"
    tr.note_field(record, rng.uniform(size=(2, 3)), rng.uniform(size=(2, 3, 3)), rng.uniform(size=(2, 3, 3)))
    tr.note_aim(record, "right", transform(rng.normal(size=3)), [0.01, 0.02, 0.03], rng.normal(size=(4, 3)))
    record["X_world_object"] = transform(rng.normal(size=3), exp_so3(rng.normal(size=3)))
    record["object_stamp_ns"] = now_ns - 40_000_000
    tr.note_timing(record, 11_000, 300_000)
    for name, value in fields.items():
        record[name] = value
    return record


def test_joints_arrive_as_they_were_recorded() -> None:
    record = record_of(7, np.random.default_rng(0))
    seen: list[str] = []
    for side in SIDES:
        for limb in ("arm", "hand"):
            sent = state_of(record, f"state/{side}/{limb}", Stamps(3, 1000))
            got = decode_message(encode_message(sent))
            assert isinstance(got, JointsState)
            indices = [LAYOUT.index(name) for name in got.name]
            for name, values in (("position", got.position), ("velocity", got.velocity), ("torque", got.effort)):
                assert np.array_equal(record[name][indices], values)
            assert np.array_equal(record["target"][indices], got.target)
            assert (got.seq, got.tick, got.stamp_ns - got.mono_ns) == (3, 7, 1000)
            assert got.age_s == pytest.approx(0.0005)
            seen += got.name
    assert seen == list(LAYOUT.names)


def test_what_is_not_a_number_arrives_as_null() -> None:
    record = record_of(0, np.random.default_rng(0))
    record["position"][3], record["torque"][2] = np.nan, np.inf
    tr.note_command(record, None, False)
    got = decode_message(encode_message(state_of(record, "state/right/arm", Stamps(0))))
    assert isinstance(got, JointsState)
    assert got.position[3] is None and got.effort[2] is None and got.position[0] is not None
    assert got.target == [None] * 7


def test_the_object_arrives_with_its_age_or_as_unseen() -> None:
    record = record_of(0, np.random.default_rng(1))
    got = decode_message(encode_message(state_of(record, "state/object", Stamps(0))))
    assert isinstance(got, ObjectState) and got.orientation_xyzw is not None
    assert np.allclose(got.position, record["X_world_object"][:3, 3])
    assert got.age_s == pytest.approx(0.040) and got.source == "perception"
    record["X_world_object"] = np.nan
    unseen = state_of(record, "state/object", Stamps(0))
    assert isinstance(unseen, ObjectState)
    assert (unseen.source, unseen.position, unseen.age_s) == ("none", None, None)


def test_the_task_arrives_with_each_groups_distance() -> None:
    record = record_of(0, np.random.default_rng(2))
    got = decode_message(encode_message(state_of(record, "state/task", Stamps(0))))
    assert isinstance(got, TaskState)
    assert (got.task, got.task_name, got.phase, got.mode, got.status) == (1, "grasp", "approach", "running", "ARMED")
    for hand, side in enumerate(SIDES):
        readings = [got.groups[side][group] for group in tr.GROUPS]
        assert [reading.distance for reading in readings] == record["group_distance"][hand].tolist()
        assert [reading.point for reading in readings] == record["group_point"][hand].tolist()
        assert [reading.force for reading in readings] == record["group_force"][hand].tolist()


def test_the_task_arrives_with_what_each_hand_is_on_its_way_to() -> None:
    record = record_of(0, np.random.default_rng(2))
    got = state_of(record, "state/task", Stamps(0))
    assert isinstance(got, TaskState) and list(got.aims) == ["right"]
    aim = got.aims["right"]
    assert list(aim.tips.values()) == record["tip_target"][0].tolist() and aim.box_size == [0.02, 0.04, 0.06]
    tr.note_aim(record, "right", np.nan, np.nan, record["tip_target"][0])
    without_box = state_of(record, "state/task", Stamps(0))
    assert isinstance(without_box, TaskState) and without_box.aims["right"].box_size is None


@given(st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3))
@settings(max_examples=100, deadline=None)
def test_a_quaternion_turns_vectors_like_its_matrix(w: list[float]) -> None:
    R = exp_so3(w)
    x, y, z, scalar = quaternion_xyzw(R)
    v = np.array([0.3, -0.5, 0.8])
    t = 2.0 * np.cross([x, y, z], v)
    assert scalar >= 0.0 and np.isclose(x * x + y * y + z * z + scalar * scalar, 1.0)
    assert np.allclose(v + scalar * t + np.cross([x, y, z], t), R @ v, atol=1e-7)


def test_every_change_is_one_event_and_the_numbers_have_no_gap() -> None:
    rng, finder = np.random.default_rng(0), EventFinder()
    changes = [{}, {}, {"phase": b"close"}, {"phase": b"close"}, {"phase": b"lift", "task": 2},
               {"phase": b"lift", "task": 2, "status": 3, "fault": b"overheated"}]  # fmt: skip
    events = [event for tick, change in enumerate(changes) for event in finder.see(record_of(tick, rng, **change))]
    events.append(finder.note("drops", "warning", "3 records lost"))
    assert [event.seq for event in events] == list(range(len(events)))
    told = [(event.tick, event.kind, event.text) for event in events[4:]]
    assert told == [
        (2, "phase", "close"),
        (4, "task", "find opening"),
        (4, "phase", "lift"),
        (5, "mode", "device is FAULT"),
        (5, "fault", "overheated"),
        (5, "drops", "3 records lost"),
    ]
    assert [event.kind for event in finder.see(record_of(6, rng, stop_reason=b"enough"))][0] == "stop"


def test_health_is_over_the_last_second_and_counts_over_the_run() -> None:
    rng, meter = np.random.default_rng(0), HealthMeter(PERIOD_NS)
    assert meter.loop(0) is None and meter.device("mujoco", 0) is None
    for first in range(0, 1500, 100):
        records = np.array([record_of(tick, rng) for tick in range(first, first + 100)])
        if first == 0:
            records["compute_ns"] = 3_000_000
        meter.see(records)
    loop, device = meter.loop(4), meter.device("mujoco", 5)
    assert loop is not None and device is not None
    assert (loop.count, loop.overruns) == (1500, 100)
    assert loop.rate_hz == pytest.approx(500.0)
    assert loop.compute_us is not None and loop.compute_us.max == pytest.approx(300.0)
    assert loop.jitter_us is not None and loop.jitter_us.max == 0.0
    assert device.age_ms is not None and device.age_ms.p50 == pytest.approx(0.5)


def test_a_device_that_samples_at_half_the_loops_rate_is_said_to() -> None:
    rng, meter = np.random.default_rng(0), HealthMeter(PERIOD_NS)
    records = np.array([record_of(tick, rng) for tick in range(1500)])
    records["stamp_ns"][1::2] = records["stamp_ns"][::2]
    for first in range(0, 1500, 100):
        meter.see(records[first : first + 100])
    loop, device = meter.loop(0), meter.device("mujoco", 0)
    assert loop is not None and device is not None
    assert loop.rate_hz == pytest.approx(500.0) and device.rate_hz == pytest.approx(250.0, abs=1.0)
    assert (loop.count, device.count) == (1500, 750)


def test_what_cannot_be_read_is_refused_with_the_field() -> None:
    with pytest.raises(msgspec.ValidationError, match="seq"):
        decode_message(b'{"schema":"preshape/joints/1"}')
    data = json.loads(encode_message(state_of(record_of(0, np.random.default_rng(0)), "state/object", Stamps(0))))
    with pytest.raises(msgspec.ValidationError, match="unknown field"):
        decode_message(json.dumps(data | {"more": 1}).encode())


def test_every_key_has_a_published_schema() -> None:
    info = decode_message(encode_message(schema_info()))
    for key, schema in info.keys.items():
        definition = info.definitions[schema]["$ref"].rpartition("/")[2]
        assert info.definitions[definition]["properties"]["schema"] == {"enum": [schema]}
        assert SCHEMAS[key.removeprefix("preshape/<robot>/")].__name__ == definition
    assert set(STATES) <= set(SCHEMAS)


def test_the_robots_description_names_every_joint() -> None:
    urdf = robot_urdf()
    info = robot_info("box", "mujoco", False, 500.0, {"state/task": 20.0})
    assert [joint.name for joint in info.joints] == list(LAYOUT.names)
    assert all(f'name="{name}"' in urdf for name in LAYOUT.names)
    assert tuple(info.tasks) == box_opening.TASK_NAMES


@pytest.mark.parametrize("name", ["", "a/b", "*", "@x", "a$b", "x" * 65, ".a"])
def test_a_robots_id_may_not_hold_what_zenoh_gives_a_meaning(name: str) -> None:
    with pytest.raises(ConfigurationError, match="--robot: got"):
        check_name(name)


def test_keys_lead_back_to_their_messages() -> None:
    keys = Keys("one")
    assert keys.joints("left", "hand") == "preshape/one/state/left/hand"
    assert message_type(keys.tail("preshape/one/state/left/hand")) is JointsState
    assert message_type("health/loop") is SCHEMAS["health/*"] and message_type("state/nothing") is None
    with pytest.raises(ValueError, match="allowed is preshape/one/"):
        keys.tail("preshape/two/event")
