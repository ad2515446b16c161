"""Laws of the log of a driver's buses in real time: all that passed, in its order, whatever becomes of the driver."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from bus_processes import multicast_addresses
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recorded_bus import BUSES, drive
from zenoh_robot import until

from preshape.hal.can.bus_address import open_bus
from preshape.hal.can.frame_length import FD_LENGTHS
from preshape.hal.can.frame_ring import FRAME, FrameWriter, frames_of
from preshape.hal.can.tapped_bus import TappedBus
from preshape.hal.tick_ring import RingReader, RingWriter, ring_memory
from preshape.sim_backend.bus_log import BusLog
from preshape.tools.bus_recorder import BusRecorder, copy_frames

SPAWN = multiprocessing.get_context("spawn")

frames = st.builds(
    lambda extended, frame_id, fd, data: can.Message(
        arbitration_id=frame_id % (1 << 29 if extended else 1 << 11),
        is_extended_id=extended,
        is_fd=fd,
        bitrate_switch=fd,
        data=data if fd else data[:8],
    ),
    st.booleans(),
    st.integers(0, (1 << 29) - 1),
    st.booleans(),
    st.sampled_from(FD_LENGTHS).flatmap(lambda length: st.binary(min_size=length, max_size=length)),
)


class Ends:
    """Both ends of a virtual bus: `own` is written down."""

    def __init__(self, over: Callable[[can.BusABC], can.BusABC], channel: str) -> None:
        where = {"interface": "virtual", "channel": channel, "protocol": can.CanProtocol.CAN_FD}
        self.own, self.other = over(can.Bus(**where)), can.Bus(**where)

    def close(self) -> None:
        """Give both back."""
        self.own.shutdown()
        self.other.shutdown()


def told(message: can.Message, received: bool, bus: str = BUSES[0]) -> tuple[object, ...]:
    """Return what must be kept of a frame."""
    return (bus, message.arbitration_id, message.is_extended_id, message.is_fd, bytes(message.data), received)


def read(file: Path) -> list[can.Message]:
    """Return the frames of a log."""
    with can.LogReader(file) as log:
        return list(log)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(sent=st.lists(st.tuples(st.booleans(), frames), max_size=20))
def test_every_frame_survives_its_record(sent: list[tuple[bool, can.Message]]) -> None:
    memory = ring_memory(SPAWN, 64, FRAME)
    writer, reader = FrameWriter(RingWriter(memory, FRAME)), RingReader(memory, 0, FRAME)
    before = time.time()
    for number, (received, message) in enumerate(sent):
        message.timestamp = 1e9 + number if received else 0.0
        writer.write(number % 2, message, received)
    got = list(frames_of(reader.read(), BUSES))
    assert [told(one, one.is_rx, str(one.channel)) for one in got] == [
        told(message, received, BUSES[number % 2]) for number, (received, message) in enumerate(sent)
    ]
    for number, ((received, _), one) in enumerate(zip(sent, got, strict=True)):
        assert one.timestamp == pytest.approx(1e9 + number) if received else before <= one.timestamp <= time.time()


def test_a_tapped_bus_passes_everything_on_and_tells_what_has_passed() -> None:
    heard: list[tuple[can.Message, bool]] = []
    ends = Ends(lambda bus: TappedBus(bus, lambda message, received: heard.append((message, received))), "tapped")
    ends.own.send(can.Message(arbitration_id=1, data=b"a"))
    ends.other.send(can.Message(arbitration_id=2, data=b"b"))
    assert ends.other.recv(1.0) is not None and ends.own.recv(0.0) is not None and ends.own.recv(0.0) is None
    assert [(message.arbitration_id, received) for message, received in heard] == [(1, False), (2, True)]
    ends.close()
    with pytest.raises(can.CanOperationError):
        ends.own.send(can.Message(arbitration_id=3))
    assert len(heard) == 2


@pytest.mark.bus
def test_what_comes_back_to_who_has_sent_it_is_told_once() -> None:
    address = multicast_addresses()["arms"]
    heard: list[int] = []
    bus = TappedBus(
        open_bus(address, "fd"), lambda message, received: heard.append(message.arbitration_id), address.echoes
    )
    bus.send(can.Message(arbitration_id=7, is_extended_id=False, is_fd=True, data=b"a"))
    while bus.recv(0.5) is not None:
        continue
    bus.shutdown()
    assert heard == [7]


@pytest.mark.bus
def test_the_log_holds_all_frames_of_all_buses_in_the_order_of_their_stamps(tmp_path: Path) -> None:
    file = tmp_path / "can.log"
    with BusRecorder(file, BUSES) as recorder:
        both = [Ends(lambda bus, name=name: recorder.over(name, bus), f"recorded {name}") for name in BUSES]
        for number in range(3000):
            ends = both[number % 2]
            ends.own.send(can.Message(arbitration_id=number % 2000, is_extended_id=False, is_fd=True, data=b"ab"))
            ends.other.send(can.Message(arbitration_id=number % 2000, is_extended_id=False, data=b"c"))
            # What waits in a socket has its stamp before the frames that are sent until it is taken.
            if number % 50 == 49:
                while both[0].own.recv(0.0) is not None or both[1].own.recv(0.0) is not None:
                    pass
        for ends in both:
            ends.close()
    log = read(file)
    assert len(log) == 6000 and not [frame for frame in log if frame.is_error_frame]
    assert all(np.diff([frame.timestamp for frame in log]) >= 0.0)
    for number, name in enumerate(BUSES):
        of_bus = [frame for frame in log if frame.channel == name]
        for received, data in ((False, b"ab"), (True, b"c")):
            ids = [frame.arbitration_id for frame in of_bus if frame.is_rx == received and bytes(frame.data) == data]
            assert ids == [count % 2000 for count in range(number, 3000, 2)]


@pytest.mark.bus
def test_what_was_lost_shows_as_an_error_frame(tmp_path: Path) -> None:
    memory, file = ring_memory(SPAWN, 16, FRAME), tmp_path / "can.log"
    ring = RingWriter(memory, FRAME)
    writer = FrameWriter(ring)
    for number in range(100):
        writer.write(0, can.Message(arbitration_id=number, is_extended_id=False), False)
    ring.end()
    written = BusLog(file)
    copy_frames(RingReader(memory, 0, FRAME), BUSES, written, lambda: True)
    written.close()
    log = read(file)
    assert [frame.is_error_frame for frame in log] == [True] + 16 * [False]
    assert [frame.arbitration_id for frame in log[1:]] == list(range(84, 100))


@pytest.fixture
def driver(tmp_path: Path) -> Iterator[multiprocessing.process.BaseProcess]:
    # Not a daemon: those may have no children.
    process = SPAWN.Process(target=drive, args=(str(tmp_path / "can.log"), "killed"))
    process.start()
    yield process
    process.kill()
    process.join()


@pytest.mark.bus
def test_a_killed_driver_leaves_a_whole_log_complete_to_its_last_second(
    tmp_path: Path, driver: multiprocessing.process.BaseProcess
) -> None:
    file = tmp_path / "can.log"
    assert until(lambda: file.exists() and file.stat().st_size > 20_000, 60.0)
    killed_s = time.time()
    os.kill(driver.pid or 0, signal.SIGKILL)
    assert until(lambda: file.read_text().endswith("\n") and read(file)[-1].timestamp > killed_s - 1.0, 30.0)
    log = read(file)
    assert [int.from_bytes(frame.data, "big") for frame in log] == list(range(len(log)))
