"""`preshape run`: carry out the procedure in a scenario's world and write what came of it."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.run_options import RunOptions

if TYPE_CHECKING:
    from preshape.tools.report import Report

MOST_SLIP = 0.02
"""Share of the simulated time for which a scene in real time may have stood still without being told of."""

EXAMPLES = (
    ("preshape run", "opens the shipped tea box"),
    ("preshape run --scenario tea_box_lying --seed 7 --out runs/lying", "another world; its files go there"),
    ("preshape run --set box.friction=0.5 --until-task 1", "a smoother box, the first grasp only"),
    ("preshape run --device can --faults drop=0.01", "over joint modules on CAN buses that lose frames"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options(RunOptions):
    """Carry out the procedure in a scenario's world and write report, recordings and pictures.

    Attributes:
        scenario: a scenario's TOML file, or the name of one that is shipped.
        seed: what the scenario leaves to chance is drawn by this; default: the scenario's own seed.
        out: folder for the results; default: runs/<time>-<scenario>-<seed>/.
        overrides: a scenario field to be set; may be given several times.
        telemetry: publish the run over Zenoh, for this machine only, and take stops from there.
        telemetry_config: the same, as a TOML file says: robot id, rates, services, Zenoh configuration.
        dashboard: watch the run in the rerun viewer (see `preshape dash`), which closes with it; with telemetry.
    """

    scenario: str = "tea_box"
    seed: int | None = None
    out: Path | None = None
    overrides: Annotated[
        tuple[str, ...], tyro.conf.arg(name="set", metavar="TABLE.FIELD=VALUE"), tyro.conf.UseAppendAction
    ] = ()
    telemetry: bool = False
    telemetry_config: Path | None = None
    dashboard: bool = False

    def __post_init__(self) -> None:
        RunOptions.__post_init__(self)
        if self.seed is not None and self.seed < 0:
            raise ConfigurationError(f"--seed: got {self.seed}, allowed is >= 0")


def execute(options: Options) -> int:
    """Run and report; return the exit code."""
    from preshape.sim_backend.judged import judged
    from preshape.tools.configuration import load_scenario
    from preshape.tools.dash_child import DashChild
    from preshape.tools.progress import RunProgress
    from preshape.tools.recorder import Recorder
    from preshape.tools.run_directory import run_directory, write_run
    from preshape.tools.session import run_session
    from preshape.tools.stop_signals import StopSignals
    from preshape.tools.telemetry_file import load_telemetry

    scenario = load_scenario(options.scenario, options.overrides)
    seed = scenario.seed if options.seed is None else options.seed
    wanted = options.telemetry or options.telemetry_config is not None or options.dashboard
    telemetry = load_telemetry(options.telemetry_config) if wanted else None
    dashboard = DashChild(telemetry) if telemetry is not None and options.dashboard else nullcontext()
    watched = RunProgress(judged(scenario.shape).names)
    with run_directory(options.out, scenario.name, seed) as directory, StopSignals() as signals:
        bus_log = directory / "can.log" if options.device == "can" and options.record else None
        with dashboard, Recorder(directory) as recorder, watched as progress:
            kept = recorder if options.record else None
            result = run_session(scenario, seed, options, [progress.watch], telemetry, bus_log, kept, signals)
        files = recorder.files | write_run(result, directory)
    if bus_log is not None and bus_log.exists():
        files["bus log"] = bus_log
    print(summary(result.report))
    for name, file in files.items():
        print(f"{name + ':':<12}{file}")
    print(directory)
    return result.exit_code


def summary(report: Report) -> str:
    """Return the outcome in one or two lines."""
    how_long = f"{report.sim.seconds:.1f} s simulated, {report.sim.realtime_factor:.2f} x real time"
    if report.sim.slipped_s > MOST_SLIP * report.sim.seconds:
        how_long += f"; the scene stood still for {report.sim.slipped_s:.1f} s, the machine being too slow: see --pace"
    if report.success:
        return f"success: {report.done} ({how_long})"
    return f"failed: {report.failure}\n({how_long})"
