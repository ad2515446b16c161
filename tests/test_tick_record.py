"""Laws of the tick record and of those who are told of it."""

from __future__ import annotations

import numpy as np

from preshape.control import groups
from preshape.control.observer import Observers
from preshape.hal import tick_record as tr
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState
from preshape.hal.transform import exp_so3, transform
from preshape.hal.world import PoseSample
from preshape.tools.tick_buffer import TickBuffer


def filled(record: tr.TickRecord, tick: int, rng: np.random.Generator, phase: str = "approach") -> RobotState:
    """Fill a record with a random tick at 2 ms a tick and return the state it was filled from."""
    now_ns = 10**12 + tick * 2_000_000
    position, velocity, torque = rng.normal(size=(3, LAYOUT.dof))
    state = RobotState(tick, position, velocity, torque, np.full(LAYOUT.dof, now_ns - 5), DeviceStatus.ARMED)
    sample = PoseSample(now_ns - 7, transform(rng.normal(size=3), exp_so3(rng.normal(size=3))))
    tr.note_state(record, tick, now_ns, state)
    tr.note_command(record, RobotCommand(tick + 1, Mode.POSITION, position + 0.1, np.ones(LAYOUT.dof)), True)
    tr.note_progress(record, 1, phase, "track", sample)
    tr.note_field(record, rng.uniform(size=(2, 3)), rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 3, 3)))
    tr.note_aim(record, "left", sample.X_world_box, (0.1, 0.2, 0.3), rng.normal(size=(4, 3)))
    tr.note_timing(record, 11, 13)
    return state


def test_record_holds_what_was_noted() -> None:
    record = tr.new_record()
    state = filled(record, 4, np.random.default_rng(0))
    assert np.array_equal(record["position"], state.position)
    assert np.array_equal(record["torque"], state.torque)
    assert np.allclose(record["target"] - record["position"], 0.1)
    assert record["command_sequence"] == 5
    assert record["commanded"] and record["taken"]
    assert tr.text_of(record, "phase") == "approach"
    assert (record["lateness_ns"], record["compute_ns"]) == (11, 13)
    assert record["now_ns"] - record["object_stamp_ns"] == 7
    assert np.isfinite(record["group_force"]).all()
    assert record["preshape_half"][1].tolist() == [0.1, 0.2, 0.3] and np.isnan(record["preshape_half"][0]).all()


def test_tick_without_command_or_pose_keeps_nothing_of_the_tick_before() -> None:
    record = tr.new_record()
    filled(record, 4, np.random.default_rng(0))
    tr.note_command(record, None, False)
    tr.note_progress(record, 0, "", "", None)
    assert not record["commanded"]
    assert np.all(np.isnan(record["target"]))
    assert np.all(np.isnan(record["X_world_object"]))
    assert tr.text_of(record, "phase") == ""


def test_groups_are_the_controllers() -> None:
    assert tr.GROUPS == groups.GROUPS


def test_record_survives_its_bytes() -> None:
    record = tr.new_record()
    filled(record, 9, np.random.default_rng(3))
    copy = np.frombuffer(record.tobytes(), tr.TICK)[0]
    assert copy.tobytes() == record.tobytes()
    assert copy["task"] == 1


def test_texts_too_long_or_not_ascii_are_cut_and_replaced() -> None:
    record = tr.new_record()
    tr.note_progress(record, 1, "é" + 100 * "x", "m", None)
    assert tr.text_of(record, "phase") == "?" + (tr.TEXT_LENGTHS["phase"] - 1) * "x"


class Counting:
    """Counts what it is told and fails at one tick."""

    def __init__(self, fails_at: int | None = None) -> None:
        self.seen: list[int] = []
        self.fails_at = fails_at

    def notify(self, record: tr.TickRecord) -> None:
        """Take note of the tick's number, or fail."""
        if int(record["tick"]) == self.fails_at:
            raise OSError("disk full")
        self.seen.append(int(record["tick"]))


def test_failing_observer_is_told_no_more_and_disturbs_no_other() -> None:
    first, broken, last = Counting(), Counting(fails_at=2), Counting()
    observers = Observers([first, broken])
    observers.add(last)
    record = tr.new_record()
    for tick in range(5):
        record["tick"] = tick
        observers.notify(record)
    assert first.seen == last.seen == [0, 1, 2, 3, 4]
    assert broken.seen == [0, 1]
    assert [(name, str(error)) for name, error in observers.failures] == [("Counting", "disk full")]


def test_buffer_keeps_all_timing_and_thinned_copies_of_records() -> None:
    buffer, record, rng = TickBuffer(0.01), tr.new_record(), np.random.default_rng(1)
    states = {}
    for tick in range(3000):
        states[tick] = filled(record, tick, rng)
        buffer.notify(record)
    kept = buffer.records()
    assert len(buffer.timing()) == 3000
    assert np.all(np.diff(buffer.timing()["now_ns"]) == 2_000_000)
    assert np.array_equal(kept["tick"], np.arange(0, 3000, 5))
    for row in kept[::97]:
        assert np.array_equal(row["position"], states[int(row["tick"])].position)


def test_buffer_keeps_every_change_of_phase() -> None:
    buffer, record, rng = TickBuffer(1.0), tr.new_record(), np.random.default_rng(1)
    for tick in range(100):
        filled(record, tick, rng, "a" if tick < 33 else "b" if tick < 34 else "c")
        buffer.notify(record)
    assert buffer.records()["tick"].tolist() == [0, 33, 34]
    assert [bytes(p).decode() for p in buffer.records()["phase"]] == ["a", "b", "c"]
