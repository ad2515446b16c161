"""Faults at the frame boundary: laws of what is lost, doubled, held back, overtaken, corrupted; and their seed."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st
from manual_clock import ManualClock

from preshape.hal.can.checksum import checksum32, crc16
from preshape.hal.can.identifiers import command_id, heartbeat_id, state_id
from preshape.sim_backend.delay_line import DelayLine
from preshape.sim_backend.fault_plan import FaultEvent, FaultKind, FrameFaults
from preshape.sim_backend.faulty_bus import BUS_OFF_ERROR_ID, RESTARTED_ERROR_ID, FaultyBus, node_of
from preshape.sim_backend.frame_lottery import MOST_BITS, FrameLottery

MS = 1_000_000
CHANNELS = itertools.count()


class Ends:
    """A virtual bus: a plain host end, and a modules' end that meets faults, on one clock."""

    def __init__(self, faults: FrameFaults, seed: int = 0) -> None:
        self.clock = ManualClock()
        channel = f"faulty-{next(CHANNELS)}"
        self.host = can.Bus(channel, interface="virtual")
        self.modules = FaultyBus(can.Bus(channel, interface="virtual"), "modules", faults, seed, self.clock.now_ns)

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until_ns(self.clock.now_ns() + round(seconds * 1e9))

    def close(self) -> None:
        self.host.shutdown()
        self.modules.shutdown()


@pytest.fixture
def make_ends() -> Iterator[type[Ends]]:
    made: list[Ends] = []

    class Kept(Ends):
        def __init__(self, faults: FrameFaults, seed: int = 0) -> None:
            super().__init__(faults, seed)
            made.append(self)

    yield Kept
    for ends in made:
        ends.close()


def _frame(number: int, frame_id: int = command_id(0), length: int = 8) -> can.Message:
    data = number.to_bytes(4, "little") + bytes(length - 4)
    return can.Message(arbitration_id=frame_id, data=data, is_extended_id=False, is_fd=True)


def _all(bus: can.BusABC) -> list[can.Message]:
    return list(iter(lambda: bus.recv(0.0), None))


def _numbers(messages: list[can.Message]) -> list[int]:
    return [int.from_bytes(message.data[:4], "little") for message in messages]


def _pass_down(ends: Ends, count: int) -> list[int]:
    for number in range(count):
        ends.host.send(_frame(number))
    return _numbers(_all(ends.modules))


def test_without_faults_frames_pass_both_ways_as_they_are(make_ends: type[Ends]) -> None:
    ends = make_ends(FrameFaults())
    assert _pass_down(ends, 50) == list(range(50))
    sent = _frame(7, state_id(3), 24)
    ends.modules.send(sent)
    got = ends.host.recv(0.0)
    assert got is not None
    assert (got.arbitration_id, got.data, got.is_fd) == (sent.arbitration_id, sent.data, True)


def test_the_share_of_lost_frames_is_the_chance_to_lose_one_in_each_direction(make_ends: type[Ends]) -> None:
    ends = make_ends(FrameFaults(drop=0.05))
    assert 4000 * 0.95 - 60 < len(_pass_down(ends, 4000)) < 4000 * 0.95 + 60
    for number in range(4000):
        ends.modules.send(_frame(number, state_id(1)))
    assert 4000 * 0.95 - 60 < len(_all(ends.host)) < 4000 * 0.95 + 60


def test_a_doubled_frame_comes_twice_in_a_row(make_ends: type[Ends]) -> None:
    assert _pass_down(make_ends(FrameFaults(duplicate=1.0)), 3) == [0, 0, 1, 1, 2, 2]


def test_an_overtaken_frame_comes_after_the_next_one_and_none_is_lost(make_ends: type[Ends]) -> None:
    got = _pass_down(make_ends(FrameFaults(reorder=0.3)), 300)
    assert got != sorted(got)
    assert len(got) >= 299 and len(set(got)) == len(got)
    assert max(place - number for place, number in enumerate(got)) <= 1


def test_a_delayed_frame_comes_at_its_time_and_not_before(make_ends: type[Ends]) -> None:
    ends = make_ends(FrameFaults(delay_s=0.003))
    ends.host.send(_frame(1))
    for _ in range(3):
        assert _all(ends.modules) == []
        ends.wait(0.001)
    assert _numbers(_all(ends.modules)) == [1]
    ends.modules.send(_frame(2, state_id(1)))
    ends.wait(0.002)
    assert (_all(ends.modules), _all(ends.host)) == ([], [])
    ends.wait(0.001)
    assert (_all(ends.modules), _numbers(_all(ends.host))) == ([], [2])


def test_jitter_stays_within_its_range_and_fills_it() -> None:
    line = DelayLine(FrameLottery(FrameFaults(delay_s=0.001, jitter_s=0.002), (3,)))
    for number in range(500):
        line.put(_frame(number), 0)
    assert not list(line.due(MS))
    early = len(list(line.due(2 * MS)))
    assert 200 < early < 300
    assert len(list(line.due(3 * MS))) == 500 - early


def test_a_corrupted_frame_differs_by_one_to_three_bits_and_its_checksum_tells(make_ends: type[Ends]) -> None:
    ends = make_ends(FrameFaults(corrupt=1.0))
    seen: set[int] = set()
    for number in range(300):
        content = number.to_bytes(5, "little") * 6
        frame_id = state_id(1)
        payload = content + crc16(frame_id, content).to_bytes(2, "little")
        ends.modules.send(can.Message(arbitration_id=frame_id, data=payload, is_extended_id=False, is_fd=True))
        got = ends.host.recv(0.0)
        assert got is not None
        seen.add((int.from_bytes(got.data, "little") ^ int.from_bytes(payload, "little")).bit_count())
        assert crc16(frame_id, bytes(got.data[:30])) != int.from_bytes(got.data[30:], "little")
    assert seen == set(range(1, MOST_BITS + 1))


def test_checksums_of_commands_find_every_corruption(make_ends: type[Ends]) -> None:
    ends = make_ends(FrameFaults(corrupt=1.0), 5)
    frame_id, content = command_id(0), bytes(range(60))
    payload = content + checksum32(frame_id, content).to_bytes(4, "little")
    for _ in range(500):
        ends.host.send(can.Message(arbitration_id=frame_id, data=payload, is_extended_id=False, is_fd=True))
    for got in _all(ends.modules):
        assert checksum32(frame_id, bytes(got.data[:60])) != int.from_bytes(got.data[60:], "little")


@given(st.integers(0, 2**32), st.lists(st.sampled_from([0, 4, 8, 24, 64]), max_size=80))
def test_the_same_seed_draws_the_same_fates(seed: int, lengths: list[int]) -> None:
    faults = FrameFaults(drop=0.1, duplicate=0.1, reorder=0.1, corrupt=0.2, delay_s=0.001, jitter_s=0.002)
    one, other = FrameLottery(faults, (seed, 0)), FrameLottery(faults, (seed, 0))
    assert [one.draw(n) for n in lengths] == [other.draw(n) for n in lengths]


def test_one_faults_chance_does_not_move_anothers_frames() -> None:
    only = FrameLottery(FrameFaults(duplicate=0.1), (1,))
    more = FrameLottery(FrameFaults(duplicate=0.1, corrupt=0.5, jitter_s=0.01), (1,))
    assert [only.draw(8).copies for _ in range(500)] == [more.draw(8).copies for _ in range(500)]


def test_the_buses_of_different_seeds_lose_different_frames(make_ends: type[Ends]) -> None:
    lost = [_pass_down(make_ends(FrameFaults(drop=0.5), seed), 100) for seed in range(2)]
    assert lost[0] != lost[1]


def test_a_silent_node_neither_speaks_nor_hears_and_broadcasts_still_pass(make_ends: type[Ends]) -> None:
    ends = make_ends(FrameFaults())
    ends.modules.silent.add(3)
    for frame_id in (state_id(3), heartbeat_id(3), state_id(4)):
        ends.modules.send(_frame(0, frame_id))
    assert [message.arbitration_id for message in _all(ends.host)] == [state_id(4)]
    ends.host.send(_frame(0, 0x600 + 3))
    ends.host.send(_frame(0))
    assert [message.arbitration_id for message in _all(ends.modules)] == [command_id(0)]
    assert ends.modules.counts["lost"] == 3


def test_a_bus_that_goes_off_says_so_by_an_error_frame_and_passes_nothing_until_it_is_back(
    make_ends: type[Ends],
) -> None:
    ends = make_ends(FrameFaults(delay_s=0.002))
    ends.host.send(_frame(1))
    ends.modules.send(_frame(2, state_id(1)))
    assert _all(ends.modules) == []
    ends.modules.go_off()
    (error,) = _all(ends.host)
    assert error.is_error_frame and error.arbitration_id == BUS_OFF_ERROR_ID
    ends.host.send(_frame(3))
    ends.wait(0.01)
    assert (_all(ends.modules), _all(ends.host)) == ([], [])
    ends.modules.come_back()
    assert [frame.arbitration_id for frame in _all(ends.host)] == [RESTARTED_ERROR_ID]
    ends.host.send(_frame(4))
    _all(ends.modules)
    ends.wait(0.002)
    assert _numbers(_all(ends.modules)) == [4]


def test_the_hosts_end_hears_of_its_own_bus_off() -> None:
    clock = ManualClock()
    with FaultyBus(can.Bus("alone", interface="virtual"), "host", FrameFaults(), 0, clock.now_ns) as bus:
        bus.go_off()
        (error,) = _all(bus)
        assert error.is_error_frame and error.arbitration_id == BUS_OFF_ERROR_ID


def test_waiting_for_a_frame_lasts_no_longer_than_the_time_limit(make_ends: type[Ends]) -> None:
    ends = make_ends(FrameFaults(drop=1.0))
    ends.host.send(_frame(1))
    assert ends.modules.recv(0.01) is None


@pytest.mark.parametrize(("frame_id", "node"), [(0x081, 1), (0x19F, 31), (0x5A0, None), (0x605, 5), (0x0A0, None),
                                                 (0x001, None), (0x70C, 12), (0x080, None)])  # fmt: skip
def test_the_node_of_a_frame_is_read_from_its_identifier(frame_id: int, node: int | None) -> None:
    assert node_of(frame_id) == node


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"drop": 1.5}, "drop: got 1.5, allowed is 0 .. 1"),
        ({"corrupt": -0.1}, "corrupt: got -0.1, allowed is 0 .. 1"),
        ({"jitter_s": 2.0}, "jitter_s: got 2, allowed is 0 .. 1"),
        ({"drop": float("nan")}, "drop: got nan, allowed is 0 .. 1"),
    ],
)
def test_chances_and_times_out_of_range_are_named(values: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        FrameFaults(**values)


@pytest.mark.parametrize(
    "values",
    [
        {"kind": FaultKind.HOST_STALL},
        {"kind": FaultKind.NODE_DEATH, "task": 6},
        {"kind": FaultKind.NODE_DEATH, "after_s": -1.0},
        {"kind": FaultKind.NODE_DEATH, "lasts_s": 0.0},
        {"kind": FaultKind.TORQUE_DRIFT},
        {"kind": FaultKind.BUS_OFF, "rate": 1.0},
    ],
)
def test_events_that_cannot_be_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=values["kind"].value):
        FaultEvent(**values)
