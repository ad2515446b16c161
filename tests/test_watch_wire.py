"""The monitor on log files and on a live bus, as a command."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
from wire_script import PERIOD_S, WireScript, frame

from preshape.hal.layout import LAYOUT
from preshape.tools.watch_wire import frames_of_bus, frames_of_log, main, watch
from preshape.tools.wire_monitor import WireMonitor, WireVerdict


class _Recorder(WireMonitor):
    """Keeps the frames instead of judging them."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: list[can.Message] = []

    def take(self, time_s: float, frame_id: int, data: bytes, channel: object = None, is_error: bool = False) -> None:
        self.kept.append(
            can.Message(timestamp=1e3 + time_s, arbitration_id=frame_id, data=data, is_fd=True, bitrate_switch=True,
                        is_extended_id=False, channel="vcan0")
        )  # fmt: skip


def _session(limit: float) -> list[can.Message]:
    script = WireScript()
    script.monitor = recorder = _Recorder()
    script.begin()
    script.command(limit=limit)
    return recorder.kept


@pytest.fixture(params=["can.log", "can.blf"])
def log(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    yield tmp_path / request.param


def _write(path: Path, frames: list[can.Message]) -> None:
    with can.Logger(path) as logger:
        for message in frames:
            logger(message)


@pytest.mark.parametrize(("limit", "code", "words"), [(1.0, 0, "no rule broken"), (1.1, 1, "torque limit: right_hand")])
def test_a_log_is_judged_and_the_exit_code_tells(
    log: Path, limit: float, code: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    _write(log, _session(limit))
    with pytest.raises(SystemExit) as caught:
        main([str(log)])
    printed = capsys.readouterr().out
    assert (caught.value.code, words in printed) == (code, True)
    assert "right_hand_command" in printed


def test_a_log_gives_the_verdict_of_the_wire_it_was_written_from(log: Path) -> None:
    frames = _session(1.1)
    _write(log, frames)
    from_log, direct = (watch(WireMonitor(PERIOD_S), source) for source in (frames_of_log(log), frames))
    assert _facts(from_log) == _facts(direct)
    assert from_log.broken["torque limit"] > 0


def test_slow_motion_is_judged_in_the_modules_time() -> None:
    script = WireScript()
    script.monitor = recorder = _Recorder()
    script.begin()
    script.torque["right_fore_flex"] = 1.3 * float(LAYOUT.torque[LAYOUT.index("right_fore_flex")])
    script.cycles(4)
    script.torque["right_fore_flex"] = 0.0
    script.cycles(4)
    for message in recorder.kept:
        message.timestamp *= 5.0
    assert "torque" in watch(WireMonitor(PERIOD_S), recorder.kept).broken
    assert not watch(WireMonitor(PERIOD_S), recorder.kept, pace=0.2).broken


def _facts(verdict: WireVerdict) -> tuple[object, ...]:
    return verdict.broken, verdict.frames, verdict.damaged, verdict.unknown, verdict.torque_limit_ratio


def test_a_live_bus_is_watched_for_as_long_as_was_asked() -> None:
    with can.Bus("watched", interface="virtual") as ours, can.Bus("watched", interface="virtual") as heard:
        frame_id, data = frame("quick_stop")
        message = can.Message(arbitration_id=frame_id, data=data, is_extended_id=False)
        sender = threading.Timer(0.1, ours.send, [message])
        sender.start()
        verdict = watch(WireMonitor(), frames_of_bus(heard, 0.4))
        sender.join()
    assert dict(verdict.frames) == {"quick_stop": 1}


@pytest.mark.parametrize("arguments", [["nowhere.log"], ["--interface", "no_such_interface"]])
def test_what_cannot_be_watched_is_one_line_and_exit_code_3(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    error = capsys.readouterr().err.strip()
    assert caught.value.code == 3
    assert error.startswith("watch_wire: ") and "\n" not in error
