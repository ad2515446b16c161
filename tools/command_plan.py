"""`preshape plan`: plan a scenario's task and show what came of it; nothing moves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.exit_codes import ExitCode

if TYPE_CHECKING:
    from preshape.tools.planned_task import PlannedTask

EXAMPLES = (
    ("preshape plan", "the shipped tea box, with the seed of its own"),
    ("preshape plan --scenario tea_box_lying --seed 3 --picture plan.png", "tables, and a picture"),
    ("preshape plan --scenario l_carton --json", "for a program"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Plan a scenario's task: priorities, areas, preshaping boxes and preshapes; exit code 1 when there is no plan.

    Attributes:
        scenario: a scenario's TOML file, or the name of one that is shipped.
        seed: what the scenario leaves to chance is drawn by this; default: the scenario's own seed.
        json: print one JSON object instead of tables.
        picture: draw the plan into this PNG file.
        reading: of the equation for G_l3: whole areas subtracted (literal), or what the hands have chosen (committed).
        palm_on_end_caps_only: leave only components with the palm on an end cap, as in the paper.
        overrides: a scenario field to be set; may be given several times.
    """

    scenario: str = "tea_box"
    seed: int | None = None
    json: bool = False
    picture: Path | None = None
    reading: Literal["committed", "literal"] = "committed"
    palm_on_end_caps_only: bool = False
    overrides: Annotated[
        tuple[str, ...], tyro.conf.arg(name="set", metavar="TABLE.FIELD=VALUE"), tyro.conf.UseAppendAction
    ] = ()

    def __post_init__(self) -> None:
        if self.seed is not None and self.seed < 0:
            raise ConfigurationError(f"--seed: got {self.seed}, allowed is >= 0")
        if self.picture is not None and self.picture.suffix.lower() != ".png":
            raise ConfigurationError(f"--picture: got {self.picture}, allowed is a .png file")


def execute(options: Options) -> int:
    """Plan, print, draw; return the exit code."""
    from preshape.tools.configuration import load_scenario
    from preshape.tools.planned_task import plan_task

    scenario = load_scenario(options.scenario, options.overrides)
    drawn = scenario.drawn(scenario.seed if options.seed is None else options.seed)
    try:
        task = plan_task(drawn, options.reading, options.palm_on_end_caps_only)
    except ValueError as error:
        raise ConfigurationError(f"{options.scenario}: {error}") from error
    if options.json:
        import msgspec

        from preshape.tools.plan_report import task_plan_report

        print(msgspec.json.format(msgspec.json.encode(task_plan_report(task)), indent=2).decode())
    else:
        from rich.console import Console

        from preshape.tools.plan_table import print_plan

        print_plan(task, Console())
    if options.picture is not None:
        _draw(task, options.picture, quiet=options.json)
    return ExitCode.DONE if task.feasible else ExitCode.TASK_FAILED


def _draw(task: PlannedTask, path: Path, quiet: bool) -> None:
    from preshape.tools.plan_picture import plan_picture
    from preshape.tools.plan_sketch import plan_drawing
    from preshape.tools.raster import save_png

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        save_png(plan_picture(plan_drawing(task)), path)
    except OSError as error:
        raise ConfigurationError(f"--picture: {path} cannot be written: {error.strerror}") from error
    if not quiet:
        print(f"picture: {path}")
