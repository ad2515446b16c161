"""`preshape run`: carry out the procedure in a scenario's world and write what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from preshape.tools.run_options import RunOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class Options(RunOptions):
    """Carry out the procedure in a scenario's world and write report.json, report.html, recording.rrd, storyboard.png.

    Attributes:
        scenario: a scenario's TOML file, or the name of one that is shipped.
        seed: what the scenario leaves to chance is drawn by this.
        out: folder for the results; default runs/<time>-<scenario>-<seed>/.
        overrides: a scenario field to be set, as table.field=value; may be given several times.
    """

    scenario: str = "tea_box"
    seed: int = 0
    out: Path | None = None
    overrides: Annotated[
        tuple[str, ...], tyro.conf.arg(name="set", metavar="TABLE.FIELD=VALUE"), tyro.conf.UseAppendAction
    ] = ()

    def __post_init__(self) -> None:
        RunOptions.__post_init__(self)


def execute(options: Options) -> int:
    """Run and report; return the exit code."""
    from preshape.tools.configuration import load_scenario
    from preshape.tools.run_directory import choose_directory, write_run
    from preshape.tools.session import run_session

    scenario = load_scenario(options.scenario, options.overrides)
    directory = choose_directory(options.out, scenario.name, options.seed)
    result = run_session(scenario, options.seed, options)
    write_run(result, directory)
    print(result.failure or "the box is open")
    print(directory)
    return result.exit_code
