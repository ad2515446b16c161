"""Laws of the kernel's own CAN stack that the driver relies on; run where vcan0 is up (`tests/test_vcan.py`)."""

from __future__ import annotations

import errno
from collections.abc import Iterator

import can
import pytest

CHANNEL = "vcan0"


def _bus(**options: object) -> can.BusABC:
    return can.Bus(CHANNEL, interface="socketcan", fd=True, **options)


@pytest.fixture
def ends() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    with _bus() as sender, _bus() as receiver:
        yield sender, receiver


def _frame(arbitration_id: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=False, is_fd=True, bitrate_switch=True)


@pytest.mark.parametrize("length", [0, 8, 12, 24, 32, 48, 64])
def test_an_fd_frame_arrives_as_it_was_sent(ends: tuple[can.BusABC, can.BusABC], length: int) -> None:
    sender, receiver = ends
    sent = _frame(0x0A0, bytes(range(length)))
    sender.send(sent)
    got = receiver.recv(1.0)
    assert got is not None
    assert (got.arbitration_id, bytes(got.data)) == (sent.arbitration_id, bytes(sent.data))
    assert got.is_fd and got.bitrate_switch and not got.is_error_frame and not got.is_extended_id


def test_the_kernel_filters_identifiers_before_they_are_received(ends: tuple[can.BusABC, can.BusABC]) -> None:
    sender, _ = ends
    with _bus(can_filters=[{"can_id": 0x180, "can_mask": 0x7F0, "extended": False}]) as filtered:
        for identifier in (0x0A0, 0x181, 0x701, 0x18F):
            sender.send(_frame(identifier, b"\0" * 8))
        got = [filtered.recv(1.0), filtered.recv(1.0)]
        assert [message.arbitration_id for message in got if message] == [0x181, 0x18F]
        assert filtered.recv(0.05) is None


def test_frames_keep_their_order(ends: tuple[can.BusABC, can.BusABC]) -> None:
    sender, receiver = ends
    for number in range(100):
        sender.send(_frame(0x100 + number, bytes([number])))
    got = [receiver.recv(1.0) for _ in range(100)]
    assert [bytes(message.data) for message in got if message] == [bytes([number]) for number in range(100)]


def test_a_sender_does_not_hear_itself(ends: tuple[can.BusABC, can.BusABC]) -> None:
    sender, _ = ends
    sender.send(_frame(0x0A0, b"\0" * 8))
    assert sender.recv(0.05) is None


def test_a_missing_interface_says_no_such_device() -> None:
    with pytest.raises(OSError) as caught:
        can.Bus("vcan99", interface="socketcan", fd=True)
    assert caught.value.errno == errno.ENODEV
