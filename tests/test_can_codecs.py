"""The codecs: round trips, equality with the shipped DBC through cantools, and refusal of what is damaged."""

from __future__ import annotations

from typing import Any

import cantools
import numpy as np
import pytest
from cantools.database.can import Database
from hypothesis import given
from hypothesis import strategies as st

from preshape.hal.can.command_codec import CommandCodec
from preshape.hal.can.dbc import CLASSIC_DBC_FILE, DBC_FILE, dbc_text
from preshape.hal.can.emergency_codec import Emergency, decode_emergency, encode_emergency
from preshape.hal.can.heartbeat_codec import Heartbeat, decode_heartbeat, encode_heartbeat
from preshape.hal.can.identifiers import QUICK_STOP_ID, emergency_id, heartbeat_id, reply_id, request_id
from preshape.hal.can.parameter_codec import (
    Reply,
    Request,
    decode_reply,
    decode_request,
    encode_reply,
    encode_request,
)
from preshape.hal.can.quick_stop_codec import QuickStop, StopReason, decode_quick_stop, encode_quick_stop
from preshape.hal.can.slices import Joiner, cut, slice_count
from preshape.hal.can.state_codec import ModuleReport, StateCodec
from preshape.hal.can.topology import TOPOLOGY, Group, Module
from preshape.hal.can.vocabulary import (
    REAL_PARAMETERS,
    Answer,
    ModuleError,
    ModuleState,
    Operation,
    Parameter,
    WireMode,
)

GROUPS = st.sampled_from(TOPOLOGY.groups)
MODULES = st.sampled_from(TOPOLOGY.modules)
U8, U16, U32 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32))
STATUS = st.tuples(st.sampled_from(ModuleState), st.sampled_from(ModuleError))


@pytest.fixture(scope="module")
def dbc() -> Database:
    database = cantools.database.load_file(DBC_FILE)
    assert isinstance(database, Database)
    return database


@pytest.fixture(scope="module")
def classic() -> Database:
    database = cantools.database.load_file(CLASSIC_DBC_FILE)
    assert isinstance(database, Database)
    return database


def decoded(dbc: Database, frame_id: int, payload: bytes | bytearray) -> dict[str, Any]:
    """Return what cantools reads, scaled, numbers instead of words."""
    values = dbc.get_message_by_frame_id(frame_id).decode(bytes(payload), decode_choices=False)
    assert isinstance(values, dict)
    return values


def reencoded(dbc: Database, frame_id: int, payload: bytes | bytearray) -> bytes:
    """Return what cantools writes for what it has read."""
    message = dbc.get_message_by_frame_id(frame_id)
    return message.encode(message.decode(bytes(payload), decode_choices=False), strict=False)


@st.composite
def commands(draw: st.DrawFn) -> tuple[CommandCodec, int, int, WireMode, int, np.ndarray, np.ndarray]:
    codec = CommandCodec(draw(GROUPS))
    n, scale = len(codec.group.joints), codec.group.scale
    most = 2 ** (scale.position_bits - 1) - 1
    target = draw(st.lists(st.integers(-most - 1, most), min_size=n, max_size=n))
    limit = draw(st.lists(st.integers(0, 2**16 - 1), min_size=n, max_size=n))
    mode, enable = draw(st.sampled_from(WireMode)), draw(st.integers(0, codec.everything))
    values = np.array(target) * scale.position, np.array(limit) * scale.torque
    return codec, draw(U32), draw(U16), mode, enable, *values


@st.composite
def reports(draw: st.DrawFn) -> tuple[StateCodec, Module, Group, ModuleReport]:
    group = draw(GROUPS)
    module = draw(st.sampled_from(group.modules))
    codec, n, scale = StateCodec(module, group), len(module.joints), group.scale
    most = 2 ** (scale.position_bits - 1) - 1
    small = st.lists(st.integers(-(2**15), 2**15 - 1), min_size=n, max_size=n)
    position = draw(st.lists(st.integers(-most - 1, most), min_size=n, max_size=n))
    state, error = draw(STATUS)
    report = ModuleReport(
        draw(U16), state, error, draw(st.booleans()), draw(st.integers(-128, 127)), np.array(position) * scale.position,
        np.array(draw(small)) * scale.velocity, np.array(draw(small)) * scale.torque,
    )  # fmt: skip
    return codec, module, group, report


@given(commands())
def test_a_command_comes_back_as_it_was_sent_and_as_cantools_reads_it(
    dbc: Database, command: tuple[CommandCodec, int, int, WireMode, int, np.ndarray, np.ndarray]
) -> None:
    codec, session, sequence, mode, enable, target, limit = command
    payload = codec.new_payload()
    codec.encode(payload, session, sequence, mode, enable, target, limit)
    back = codec.decode(payload)
    assert back is not None
    assert (back.session, back.sequence, back.mode, back.enable) == (session, sequence, mode, enable)
    assert np.allclose(back.target, target, rtol=1e-12, atol=1e-12)
    assert np.allclose(back.torque_limit, limit, rtol=1e-12, atol=1e-12)
    values = decoded(dbc, codec.frame_id, payload)
    assert [values[name] for name in ("session", "sequence", "mode", "enable")] == [session, sequence, mode, enable]
    for place, joint in enumerate(codec.group.joints):
        assert values[f"{joint}_target"] == pytest.approx(back.target[place])
        assert values[f"{joint}_limit"] == pytest.approx(back.torque_limit[place])
    assert reencoded(dbc, codec.frame_id, payload) == bytes(payload)


@given(reports())
def test_a_state_comes_back_as_it_was_sent_and_as_cantools_reads_it(
    dbc: Database, case: tuple[StateCodec, Module, Group, ModuleReport]
) -> None:
    codec, module, group, report = case
    payload = codec.encode(report)
    back = codec.decode(payload)
    assert back is not None
    for name in ("sequence", "state", "error", "taken", "temperature_degc"):
        assert getattr(back, name) == getattr(report, name)
    for name in ("position", "velocity", "torque"):
        assert np.allclose(getattr(back, name), getattr(report, name), rtol=1e-12, atol=1e-12)
    values = decoded(dbc, codec.frame_id, payload)
    expected = (report.sequence, report.state, report.error, report.taken, report.temperature_degc)
    assert tuple(values[name] for name in ("sequence", "state", "error", "taken", "temperature")) == expected
    for place, joint in enumerate(module.joints):
        for name in ("position", "velocity", "torque"):
            assert values[f"{joint}_{name}"] == pytest.approx(getattr(back, name)[place])
    assert reencoded(dbc, codec.frame_id, payload) == bytes(payload)
    assert group.scale.velocity > 0.0


@given(MODULES, STATUS, U8, U8, U8, U16, U32, U32)
def test_a_heartbeat_comes_back_and_is_as_cantools_reads_it(
    dbc: Database, module: Module, status: tuple[ModuleState, ModuleError], count: int, major: int, minor: int,
    boots: int, serial: int, key: int,
) -> None:  # fmt: skip
    beat = Heartbeat(*status, count, major, minor, boots, serial, key)
    payload = encode_heartbeat(module.node, beat)
    assert decode_heartbeat(module.node, payload) == beat
    assert decode_heartbeat(module.node + 1, payload) is None
    values = decoded(dbc, heartbeat_id(module.node), payload)
    for name in ("state", "error", "count", "firmware_major", "firmware_minor", "boots", "serial", "key"):
        assert values[name] == getattr(beat, name)
    assert reencoded(dbc, heartbeat_id(module.node), payload) == bytes(payload)


@given(MODULES, STATUS, U8, U8, U16)
def test_an_emergency_comes_back_and_is_as_cantools_reads_it(
    dbc: Database, module: Module, status: tuple[ModuleState, ModuleError], joint: int, count: int, detail: int
) -> None:
    emergency = Emergency(*status, module.node, joint, count, detail)
    payload = encode_emergency(emergency)
    assert decode_emergency(module.node, payload) == emergency
    assert decode_emergency(module.node + 1, payload) is None
    values = decoded(dbc, emergency_id(module.node), payload)
    for name in ("state", "error", "node", "joint", "count", "detail"):
        assert values[name] == getattr(emergency, name)
    assert reencoded(dbc, emergency_id(module.node), payload) == bytes(payload)


@given(st.sampled_from(StopReason), U8, U16)
def test_a_quick_stop_comes_back_and_is_as_cantools_reads_it(
    dbc: Database, reason: StopReason, source: int, count: int
) -> None:
    stop = QuickStop(reason, source, count)
    payload = encode_quick_stop(stop)
    assert decode_quick_stop(payload) == stop
    assert decoded(dbc, QUICK_STOP_ID, payload) == {"reason": reason, "source": source, "count": count}
    assert reencoded(dbc, QUICK_STOP_ID, payload) == bytes(payload)


def value_of(parameter: Parameter, whole: int, real: float) -> float:
    """Return the drawn value that suits a parameter."""
    return real if parameter in REAL_PARAMETERS else whole


@given(MODULES, st.sampled_from(Operation), st.sampled_from(Parameter), U8, U8, U32,
       st.floats(width=32, allow_nan=False), U32)  # fmt: skip
def test_a_request_comes_back_and_is_as_cantools_reads_it(
    dbc: Database, module: Module, operation: Operation, parameter: Parameter, joint: int, tag: int, whole: int,
    real: float, key: int,
) -> None:  # fmt: skip
    frame_id = request_id(module.node)
    request = Request(operation, parameter, tag, joint, value_of(parameter, whole, real), key)
    payload = encode_request(frame_id, request)
    assert decode_request(frame_id, payload) == request
    assert decode_request(frame_id + 1, payload) is None
    values = decoded(dbc, frame_id, payload)
    assert (values["operation"], values["parameter"], values["joint"]) == (operation, parameter, joint)
    assert values[parameter.name.lower()] == request.value
    assert (values["tag"], values["arming_key"]) == (tag, key)
    assert reencoded(dbc, frame_id, payload) == bytes(payload)


@given(MODULES, st.sampled_from(Answer), st.sampled_from(Parameter), U8, U8, U32,
       st.floats(width=32, allow_nan=False), U32)  # fmt: skip
def test_a_reply_comes_back_and_is_as_cantools_reads_it(
    dbc: Database, module: Module, answer: Answer, parameter: Parameter, joint: int, tag: int, whole: int,
    real: float, key: int,
) -> None:  # fmt: skip
    frame_id = reply_id(module.node)
    reply = Reply(answer, parameter, tag, joint, value_of(parameter, whole, real), key)
    payload = encode_reply(frame_id, reply)
    assert decode_reply(frame_id, payload) == reply
    values = decoded(dbc, frame_id, payload)
    assert (values["answer"], values[parameter.name.lower()], values["arming_key"]) == (answer, reply.value, key)
    assert reencoded(dbc, frame_id, payload) == bytes(payload)


def test_the_shipped_dbc_is_the_default_topologys_and_names_every_frame_once(dbc: Database) -> None:
    assert DBC_FILE.read_text() == dbc_text(TOPOLOGY)
    assert len(dbc.messages) == 1 + len(TOPOLOGY.groups) + 5 * len(TOPOLOGY.modules)
    assert all(message.is_fd for message in dbc.messages)


def test_the_shipped_classic_dbc_is_the_default_topologys_and_has_no_frame_of_more_than_eight_bytes(
    dbc: Database, classic: Database
) -> None:
    assert CLASSIC_DBC_FILE.read_text() == dbc_text(TOPOLOGY, "classic")
    assert [message.frame_id for message in classic.messages] == [message.frame_id for message in dbc.messages]
    assert all(message.length <= 8 and not message.is_fd for message in classic.messages)


def joined(classic: Database, frame_id: int, payload: bytes | bytearray, tag: int) -> dict[str, Any]:
    """Return what cantools reads in the slices of a payload; values in two slices are added up."""
    values: dict[str, Any] = {}
    for number, content in enumerate(cut(payload, tag)):
        found = decoded(classic, frame_id, content)
        if slice_count(len(payload)) > 1:
            assert (found.pop("slice"), found.pop("slice_tag")) == (number, tag)
        for name, value in found.items():
            if name.startswith("padding"):
                assert value == 0
                continue
            whole = name.removesuffix("_low").removesuffix("_high")
            values[whole] = values.get(whole, 0) + value
    return values


@given(commands(), U8)
def test_the_slices_of_a_command_say_what_its_one_frame_says(
    dbc: Database, classic: Database,
    command: tuple[CommandCodec, int, int, WireMode, int, np.ndarray, np.ndarray], tag: int,
) -> None:  # fmt: skip
    codec, session, sequence, mode, enable, target, limit = command
    payload = codec.new_payload()
    codec.encode(payload, session, sequence, mode, enable, target, limit)
    assert joined(classic, codec.frame_id, payload, tag) == pytest.approx(decoded(dbc, codec.frame_id, payload))


@given(reports(), U8)
def test_the_slices_of_a_state_say_what_its_one_frame_says(
    dbc: Database, classic: Database, case: tuple[StateCodec, Module, Group, ModuleReport], tag: int
) -> None:
    codec, _, _, report = case
    payload = codec.encode(report)
    assert joined(classic, codec.frame_id, payload, tag) == pytest.approx(decoded(dbc, codec.frame_id, payload))


@given(commands(), st.integers(0, 64 * 8 - 1))
def test_a_command_with_one_wrong_bit_says_nothing(
    command: tuple[CommandCodec, int, int, WireMode, int, np.ndarray, np.ndarray], bit: int
) -> None:
    codec, *rest = command
    payload = codec.new_payload()
    codec.encode(payload, *rest)
    payload[bit // 8 % codec.length] ^= 1 << bit % 8
    assert codec.decode(payload) is None


@given(reports(), st.integers(0, 64 * 8 - 1))
def test_a_state_with_one_wrong_bit_says_nothing(
    case: tuple[StateCodec, Module, Group, ModuleReport], bit: int
) -> None:
    codec, _, _, report = case
    payload = codec.encode(report)
    payload[bit // 8 % codec.length] ^= 1 << bit % 8
    assert codec.decode(payload) is None


@given(commands(), st.floats(0.0, 3.0))
def test_a_torque_limit_is_never_rounded_up(
    command: tuple[CommandCodec, int, int, WireMode, int, np.ndarray, np.ndarray], limit: float
) -> None:
    codec, session, sequence, mode, enable, target, _ = command
    payload = codec.new_payload()
    codec.encode(payload, session, sequence, mode, enable, target, np.full(len(target), limit))
    back = codec.decode(payload)
    assert back is not None
    one = codec.group.scale.torque
    assert (back.torque_limit <= limit + 2e-6 * one).all()
    assert (back.torque_limit > limit - one).all()


@given(st.binary(max_size=64), MODULES)
def test_random_bytes_are_no_frame(content: bytes, module: Module) -> None:
    group = TOPOLOGY.group_of(module)
    assert CommandCodec(group).decode(content) is None
    assert decode_request(request_id(module.node), content) is None
    assert decode_reply(reply_id(module.node), content) is None


@given(st.binary(max_size=64), U8)
def test_slices_put_a_payload_together_again(payload: bytes, tag: int) -> None:
    parts = cut(payload, tag)
    assert len(parts) == slice_count(len(payload)) and all(len(part) <= 8 for part in parts)
    joiner = Joiner(len(payload))
    joined = [joiner.add(part) for part in parts]
    assert joined[-1] == payload and not any(joined[:-1])


@given(st.binary(min_size=13, max_size=64), U8, st.data())
def test_a_lost_slice_loses_its_payload_and_no_other(payload: bytes, tag: int, data: st.DataObject) -> None:
    parts = cut(payload, tag)
    lost = data.draw(st.integers(0, len(parts) - 1))
    joiner = Joiner(len(payload))
    assert not any(joiner.add(part) for place, part in enumerate(parts) if place != lost)
    assert [joiner.add(part) for part in cut(payload, (tag + 1) % 256)][-1] == payload
