"""`preshape sweep`: scenarios over many seeds in parallel, counted with intervals, per task and per cause."""

from __future__ import annotations

import errno
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.exit_codes import ExitCode
from preshape.tools.run_options import RunOptions

if TYPE_CHECKING:
    from preshape.tools.sweep_run import RunCase, RunOutcome

SCHEMA = "preshape/sweep/1"
NO_FAULTS = "none"
"""The campaign in which nothing goes wrong."""

EXAMPLES = (
    ("preshape sweep --seeds 0:4 --until-task 1 --json sweep.json", "four grasps, counted"),
    ("preshape sweep --scenario tea_box tea_box_lying --seeds 0:20", "two scenarios, twenty seeds each"),
    ("preshape sweep --device can --seeds 0 --faults none loss1 bus_off2", "a matrix of fault and outcome"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options(RunOptions):
    """Run scenarios over many seeds in parallel and count successes, tasks done and causes of failure.

    Attributes:
        scenario: scenarios' TOML files, or names of shipped ones.
        campaigns: what goes wrong on the bus, one row of a matrix each: names of campaigns, or lists of faults.
        seeds: what to draw: 7, 0:40 (40 not included), 0:40:4 or 1,5,9.
        backend: what runs them: loky (processes of this machine), threading (for a debugger), dask or ray (a cluster).
        jobs: runs at a time; 0 is one a core, and one at all when paced.
        json: write all outcomes and counts to this file, kept up to date while the sweep goes on.
        at_least: exit code 1 when a scenario succeeds less often than this.
        overrides: a scenario field to be set, as table.field=value; may be given several times.
    """

    scenario: tuple[str, ...] = ("tea_box",)
    campaigns: Annotated[tuple[str, ...], tyro.conf.arg(name="faults", metavar="FAULTS ...")] = ()
    seeds: str = "0:40"
    backend: Literal["loky", "threading", "dask", "ray"] = "loky"
    jobs: int = 0
    json: Path | None = None
    at_least: int = 1
    overrides: Annotated[
        tuple[str, ...], tyro.conf.arg(name="set", metavar="TABLE.FIELD=VALUE"), tyro.conf.UseAppendAction
    ] = ()
    faults: tyro.conf.Suppress[str] = ""
    record: tyro.conf.Suppress[bool] = False
    pictures: tyro.conf.Suppress[bool] = False

    def __post_init__(self) -> None:
        RunOptions.__post_init__(self)
        if self.jobs < 0:
            raise ConfigurationError(f"jobs: got {self.jobs}, allowed is >= 0")

    def run(self, faults: str = "") -> RunOptions:
        """Return how each run with such faults is done."""
        how = RunOptions(**{field.name: getattr(self, field.name) for field in fields(RunOptions)})
        return replace(how, faults="" if faults == NO_FAULTS else faults)


def execute(options: Options) -> int:
    """Run the sweep, print and write what came of it."""
    from preshape.tools.sweep_run import limit_threads

    # Before anything numerical is loaded, here or in a process started from here.
    limit_threads()
    from preshape.tools.fault_matrix import fault_rows, matrix
    from preshape.tools.sweep import sweep
    from preshape.tools.sweep_run import run_case
    from preshape.tools.sweep_summary import summarise
    from preshape.tools.sweep_tables import Progress, print_sweep, results_console

    cases = sweep_cases(options)
    require_writable(options.json)
    jobs = options.jobs or (1 if options.in_real_time else -1)
    done: list[RunOutcome] = []
    with Progress(len(cases)) as progress:

        def take(outcome: RunOutcome) -> None:
            done.append(outcome)
            progress.show(outcome)
            write(options, done)

        outcomes = sweep(cases, run_case, options.backend, jobs, take)
    write(options, outcomes)
    summaries = summarise(outcomes)
    print_sweep(summaries, outcomes, options.until_task)
    if options.campaigns:
        rows = fault_rows(outcomes)
        results_console().print(matrix(rows))
        return ExitCode.DONE if all(row.sound for row in rows) else ExitCode.TASK_FAILED
    enough = all(summary.success.count >= options.at_least for summary in summaries)
    return ExitCode.DONE if enough else ExitCode.TASK_FAILED


def sweep_cases(options: Options) -> list[RunCase]:
    """Return every scenario with every campaign and every seed.

    Raises:
        ConfigurationError: a file, an override, faults or the seeds cannot be read, or two scenarios have one name.
    """
    from preshape.tools.configuration import load_scenario
    from preshape.tools.fault_text import parse_faults
    from preshape.tools.sweep import parse_seeds
    from preshape.tools.sweep_run import RunCase

    scenarios = [load_scenario(name, options.overrides) for name in options.scenario]
    names = [scenario.name for scenario in scenarios]
    if len(set(names)) != len(names):
        raise ConfigurationError(f"scenario: got {', '.join(names)}, allowed are scenarios of different names")
    campaigns = options.campaigns or ("",)
    for campaign in campaigns:
        parse_faults(campaign)
    if len(set(campaigns)) != len(campaigns):
        raise ConfigurationError(f"--faults: got {' '.join(campaigns)}, allowed are different ones")
    seeds, hows = parse_seeds(options.seeds), [options.run(campaign) for campaign in campaigns]
    return [RunCase(scenario, seed, how) for scenario in scenarios for how in hows for seed in seeds]


def require_writable(file: Path | None) -> None:
    """Refuse a file that cannot be written, before anything runs: `ConfigurationError`."""
    if file is None:
        return
    try:
        if file.is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder")
        part = _part(file)
        part.parent.mkdir(parents=True, exist_ok=True)
        part.touch()
        part.unlink()
    except OSError as error:
        raise ConfigurationError(f"--json {file}: cannot be written: {error.strerror}") from error


def _part(file: Path) -> Path:
    return file.with_name(file.name + ".part")


def write(options: Options, outcomes: list[RunOutcome]) -> None:
    """Write counts and outcomes to the file asked for, whole or not at all."""
    if options.json is None:
        return
    import msgspec

    from preshape import __version__
    from preshape.tools.sweep_summary import summarise

    content = {
        "schema": SCHEMA,
        "version": __version__,
        "scenarios": options.scenario,
        "seeds": options.seeds,
        "faults": options.campaigns,
        "overrides": options.overrides,
        "options": {field.name: getattr(options, field.name) for field in fields(RunOptions)},
        "summaries": summarise(outcomes),
        "outcomes": outcomes,
    }
    part = _part(options.json)
    part.write_bytes(msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n")
    part.replace(options.json)
