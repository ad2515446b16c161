"""`preshape dash`: watch a running robot, or a recording, in the rerun viewer."""

from __future__ import annotations

import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.exit_codes import ExitCode

LARGEST_PORT = 65535

EXAMPLES = (
    ("preshape dash", "a robot that runs with --telemetry"),
    ("preshape dash --web runs/lying", "a recorded run, for a browser"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Watch a running robot, or a recording, in the rerun viewer. Ends with the viewer, or by Ctrl-C.

    Attributes:
        recording: a run's folder, its recording.rrd or recording.mcap; without it the running robot is watched.
        robot: the robot's id.
        endpoint: where it publishes, as Zenoh writes it.
        zenoh_config: a Zenoh configuration file in the endpoint's stead.
        web: serve a browser on this machine instead of opening a window; so it is where there is no display.
        port: port of this machine that streams connect to; 0 chooses one.
        web_port: port of this machine that the browser opens; 0 chooses one.
        within_s: how long to wait for the robot, s.
        seconds: end after so long; 0 does not.
    """

    recording: Annotated[Path | None, tyro.conf.Positional] = None
    robot: str = "box"
    endpoint: str = "tcp/127.0.0.1:7447"
    zenoh_config: Path | None = None
    web: bool = False
    port: int = 0
    web_port: int = 0
    within_s: float = 10.0
    seconds: float = 0.0

    def __post_init__(self) -> None:
        for flag, port in (("--port", self.port), ("--web-port", self.web_port)):
            if not 0 <= port <= LARGEST_PORT:
                raise ConfigurationError(f"{flag}: got {port}, allowed is 0 .. {LARGEST_PORT}")
        for flag, value in (("--within-s", self.within_s), ("--seconds", self.seconds)):
            if not value >= 0.0:
                raise ConfigurationError(f"{flag}: got {value:g}, allowed is >= 0")


def execute(options: Options) -> int:
    """Show until the user has seen enough; return the exit code."""
    # Ended from outside, it takes its viewer with it.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        if options.recording is None:
            _show_live(options)
        else:
            _show_recording(options, options.recording)
    except KeyboardInterrupt:
        return ExitCode.DONE
    return ExitCode.DONE


def _deadline(options: Options) -> float:
    return time.monotonic() + options.seconds if options.seconds else float("inf")


def _show_recording(options: Options, path: Path) -> None:
    from preshape.tools.rerun_viewer import RerunViewer

    file = _chosen(path)
    files = (file,) if file.suffix == ".rrd" else ()
    with RerunViewer(options.web, files, options.port, options.web_port) as viewer:
        if not files:
            from preshape.tools.dash_recording import show_recording

            show_recording(file, viewer.url)
        print(f"showing {file}{viewer.where}", flush=True)
        end_s = _deadline(options)
        while viewer.running and time.monotonic() < end_s:
            time.sleep(0.1)


def _chosen(path: Path) -> Path:
    """Return the file to be shown: of a folder the picture, if it is whole, else the inputs."""
    if path.is_dir():
        found = [path / name for name in ("recording.rrd", "recording.mcap") if (path / name).is_file()]
        if not found:
            raise ConfigurationError(f"{path}: got a folder without recording.rrd and recording.mcap")
        return found[0]
    if path.suffix not in (".rrd", ".mcap") or not path.is_file():
        raise ConfigurationError(f"{path}: got no such file, allowed are a run's folder, an .rrd or an .mcap file")
    return path


def _show_live(options: Options) -> None:
    from preshape.tools.dash_live import LiveDash, watch
    from preshape.tools.rerun_layout import blueprint
    from preshape.tools.rerun_stream import RerunStream
    from preshape.tools.rerun_viewer import RerunViewer
    from preshape.tools.robot_reach import listening
    from preshape.tools.telemetry_keys import Keys

    robot = Keys(options.robot), options.endpoint, options.zenoh_config, options.within_s
    with listening(*robot) as listener, RerunViewer(options.web, (), options.port, options.web_port) as viewer:
        stream = RerunStream.to_viewer(viewer.url, blueprint(live=True, buses=listener.has_buses))
        print(f"showing {options.robot} at {options.endpoint}{viewer.where}", flush=True)
        end_s = _deadline(options)
        dash = LiveDash(listener, stream)
        watch(dash, lambda: viewer.running and time.monotonic() < end_s, time.sleep)
