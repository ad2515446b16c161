"""Laws of states and commands as bytes: what is sent arrives bit for bit, and what is not a message is none."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from preshape.hal.layout import LAYOUT
from preshape.hal.remote_wire import (
    COMMAND,
    STATE,
    command_of,
    decode_command,
    decode_state,
    encode_command,
    encode_state,
    state_of,
)
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState

RNG = np.random.default_rng(0)


def some_state() -> RobotState:
    position, velocity, torque = RNG.normal(size=(3, LAYOUT.dof))
    stamps = RNG.integers(0, 2**62, LAYOUT.dof)
    return RobotState(7, position, velocity, torque, stamps, DeviceStatus.FAULT, "overheated")


def some_command(mode: Mode = Mode.TORQUE) -> RobotCommand:
    position, limit, torque = RNG.normal(size=(3, LAYOUT.dof))
    return RobotCommand(2**40, mode, position, limit, torque)


def test_a_state_arrives_bit_for_bit() -> None:
    sent = some_state()
    record = decode_state(encode_state(sent, 3, 4, 5))
    assert record is not None and [int(record[name]) for name in ("seq", "epoch", "sent_ns")] == [3, 4, 5]
    got = state_of(record)
    assert (got.sequence, got.status, got.fault) == (sent.sequence, sent.status, sent.fault)
    for name in ("position", "velocity", "torque", "stamp_ns"):
        assert getattr(got, name).tobytes() == getattr(sent, name).tobytes()


def test_a_state_without_numbers_arrives_as_it_is() -> None:
    nothing = np.full(LAYOUT.dof, np.nan)
    state = RobotState(-1, nothing, nothing, nothing, np.zeros(LAYOUT.dof, np.int64))
    record = decode_state(encode_state(state, 0, 0, 0))
    assert record is not None and np.isnan(state_of(record).position).all()


def test_a_command_arrives_bit_for_bit_in_every_mode() -> None:
    for mode in Mode:
        sent = some_command(mode)
        record = decode_command(encode_command(sent, 11, 12, 13))
        assert record is not None and [int(record[name]) for name in ("client", "epoch", "sent_ns")] == [11, 12, 13]
        got = command_of(record)
        assert (got.sequence, got.mode) == (sent.sequence, sent.mode)
        for name in ("position", "torque_limit", "torque"):
            assert getattr(got, name).tobytes() == getattr(sent, name).tobytes()


@given(st.binary(max_size=2000))
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_refused(payload: bytes) -> None:
    assert decode_state(payload) is None and decode_command(payload) is None


@given(st.integers(0, STATE.itemsize - 1), st.integers(1, 255))
@settings(max_examples=200, deadline=None)
def test_a_changed_byte_never_makes_a_state_that_cannot_be_read(place: int, change: int) -> None:
    payload = bytearray(encode_state(some_state(), 1, 2, 3))
    payload[place] ^= change
    record = decode_state(bytes(payload))
    if record is not None:
        assert state_of(record).status in DeviceStatus
    assert decode_state(bytes(payload[:-1])) is None


@given(st.integers(0, COMMAND.itemsize - 1), st.integers(1, 255))
@settings(max_examples=200, deadline=None)
def test_a_changed_byte_never_makes_a_command_that_is_not_finite(place: int, change: int) -> None:
    payload = bytearray(encode_command(some_command(), 1, 2, 3))
    payload[place] ^= change
    record = decode_command(bytes(payload))
    if record is not None:
        got = command_of(record)
        assert got.mode in Mode
        assert all(np.isfinite(value).all() for value in (got.position, got.torque_limit, got.torque))


def test_a_command_that_is_not_finite_is_none() -> None:
    for name in ("position", "torque_limit", "torque"):
        record = np.frombuffer(encode_command(some_command(), 1, 2, 3), COMMAND).copy()
        record[name][0, 5] = np.nan
        assert decode_command(record.tobytes()) is None
