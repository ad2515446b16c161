"""`preshape replay`: feed a recording through the controller again and compare its commands bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from preshape.tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from preshape.hal.recording import Recording
    from preshape.tools.controller_setup import ControllerSetup

EXAMPLES = (
    ("preshape replay runs/lying", "0: the same commands bit for bit"),
    ("preshape replay runs/lying --set field.ties=hard", "1: names the first tick that differs"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Feed a recording through the controller again and compare its commands bit for bit; 1 if they differ.

    Attributes:
        recording: a run's recording.mcap, or its folder.
        overrides: a field of the controller's set-up to be changed, e.g. field.ties=hard; may be given several times.
        dashboard: show the replay while it goes on, and then until the viewer is closed, or Ctrl-C.
    """

    recording: Annotated[Path, tyro.conf.Positional]
    overrides: Annotated[
        tuple[str, ...], tyro.conf.arg(name="set", metavar="TABLE.FIELD=VALUE"), tyro.conf.UseAppendAction
    ] = ()
    dashboard: bool = False


def execute(options: Options) -> int:
    """Replay and compare; return the exit code."""
    from preshape.hal.recording import read_recording
    from preshape.tools.replay import replay
    from preshape.tools.replay_dash import replayed_and_shown
    from preshape.tools.replay_setup import recorded_setup

    path = options.recording / "recording.mcap" if options.recording.is_dir() else options.recording
    recording = read_recording(path)
    setup = recorded_setup(recording, options.overrides)
    print(heading(recording, setup), flush=True)
    result = replayed_and_shown(recording, setup) if options.dashboard else replay(recording, setup)
    seconds = f"{result.wall_s:.1f} s"
    if result.equal:
        print(f"equal: {result.commands} commands in {result.ticks} ticks, bit for bit ({seconds})")
        return ExitCode.DONE
    if result.difference is not None:
        print(f"differs: {result.difference}")
    else:
        print(f"ended early: {result.end}")
    print(f"equal until then: {result.compared} of {result.ticks} ticks ({seconds})")
    return ExitCode.TASK_FAILED


def heading(recording: Recording, setup: ControllerSetup) -> str:
    """Return what is replayed in one line."""
    ticks = recording.ticks
    seconds = (int(ticks["now_ns"][-1]) - int(ticks["now_ns"][0])) * 1e-9 if len(ticks) else 0.0
    how = "paced" if setup.paced else "lockstep"
    notes = [] if recording.complete else ["its writer was killed"]
    notes += [] if recording.gap is None else [f"ticks are missing before tick {recording.gap}, replayed up to there"]
    return "; ".join([f"{setup.name}: {seconds:.1f} s, {how}, {len(ticks)} ticks", *notes])
