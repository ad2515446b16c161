"""`preshape record`: write down what a running robot publishes over Zenoh."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from preshape.tools.telemetry_listener import TelemetryListener

FLUSH_S = 0.5
"""Time after which what has come is completed in the files, s."""

EXAMPLES = (
    ("preshape record --seconds 60", "a minute of a robot that runs with --telemetry"),
    ("preshape record --complete runs/lying", "a run whose recorder was killed with it"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Write down what a running robot publishes over Zenoh: telemetry.mcap and recording.rrd.

    It ends with the robot's run, by Ctrl-C, or after --seconds. What is published is a part of the ticks: for a
    recording that replays see the files of `preshape run`.

    Attributes:
        out: folder for the files; default: runs/<time>-record-<robot>/.
        robot: the robot's id.
        endpoint: where it publishes, as Zenoh writes it.
        zenoh_config: a Zenoh configuration file in the endpoint's stead.
        within_s: how long to wait for the robot, s.
        seconds: end after so long; 0 does not.
        complete: a run's folder whose recorder was killed: its recordings are made whole instead.
    """

    out: Path | None = None
    robot: str = "box"
    endpoint: str = "tcp/127.0.0.1:7447"
    zenoh_config: Path | None = None
    within_s: float = 10.0
    seconds: float = 0.0
    complete: Path | None = None

    def __post_init__(self) -> None:
        for flag, value in (("--within-s", self.within_s), ("--seconds", self.seconds)):
            if not value >= 0.0:
                raise ConfigurationError(f"{flag}: got {value:g}, allowed is >= 0")


def execute(options: Options) -> int:
    """Record until it ends; return the exit code."""
    if options.complete is not None:
        return _complete(options.complete)
    from preshape.tools.robot_reach import listening
    from preshape.tools.run_directory import make_directory
    from preshape.tools.telemetry_keys import Keys

    directory = options.out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-record-{options.robot}"
    with listening(Keys(options.robot), options.endpoint, options.zenoh_config, options.within_s) as listener:
        make_directory(directory)
        print(f"recording {options.robot} at {options.endpoint}", flush=True)
        count = _record(options, listener, directory)
    print(f"{count} messages")
    print(directory)
    return ExitCode.DONE


def _complete(directory: Path) -> int:
    from preshape.tools.recording_repair import complete_recording

    recording = complete_recording(directory)
    state = "was whole" if recording.complete else "is whole again"
    print(f"{directory}: {state}, {len(recording.ticks)} ticks")
    return ExitCode.DONE


def _record(options: Options, listener: TelemetryListener, directory: Path) -> int:
    from preshape.tools.dash_live import LiveDash
    from preshape.tools.end_signals import EndSignals
    from preshape.tools.rerun_layout import blueprint
    from preshape.tools.rerun_stream import RerunStream
    from preshape.tools.telemetry_keys import Keys
    from preshape.tools.telemetry_messages import AnyMessage, Heartbeat
    from preshape.tools.telemetry_recording import TelemetryFile

    file = TelemetryFile(directory / "telemetry.mcap", Keys(options.robot))
    ended = False

    def keep(tail: str, message: AnyMessage) -> None:
        nonlocal ended
        file.add(tail, message, time.time_ns())
        ended = ended or (isinstance(message, Heartbeat) and message.part == "loop" and message.state == "gone")

    try:
        with EndSignals() as asked:
            stream = RerunStream.to_file(directory / "recording.rrd", blueprint(buses=listener.has_buses))
            dash = LiveDash(listener, stream, keep)
            end_s = time.monotonic() + options.seconds if options.seconds else float("inf")
            while not (ended or asked()) and time.monotonic() < end_s:
                dash.turn()
                file.flush()
                time.sleep(FLUSH_S)
            dash.close()
    finally:
        file.close()
    return file.count
