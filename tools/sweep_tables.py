"""A sweep on the terminal: a bar (or a line a run) while it goes on, tables when it is over."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Table

from preshape.tools.sweep_run import RunOutcome
from preshape.tools.sweep_summary import Summary

WIDTH = 120
"""Width of what is printed where there is no terminal to fit."""


class Progress:
    """A bar on a terminal, one line for each run elsewhere; on the error stream, so results can be piped."""

    def __init__(self, total: int) -> None:
        """Expect so many runs."""
        self._total, self._done, self._good = total, 0, 0
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        console = Console(stderr=True)
        self._bar = Bar(*columns, console=console) if console.is_terminal else None
        self._task = self._bar.add_task("runs", total=total) if self._bar is not None else None

    def __enter__(self) -> Progress:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def show(self, outcome: RunOutcome) -> None:
        """Tell of one run that has ended."""
        self._done += 1
        self._good += outcome.success
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, advance=1, description=f"{self._good} of {self._done} succeed")
            return
        result = "success" if outcome.success else outcome.failure
        print(
            f"[{self._done}/{self._total}] {outcome.label} seed {outcome.seed}: {result} ({outcome.wall_s:.0f} s)",
            file=sys.stderr,
            flush=True,
        )


def results_console() -> Console:
    """Return a console of the terminal's width, or of a fixed one where there is no terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=WIDTH)


def print_sweep(summaries: Sequence[Summary], outcomes: Sequence[RunOutcome], until_task: int) -> None:
    """Print success, tasks asked for and causes per scenario, then every failure by its seed."""
    console = results_console()
    for summary in summaries:
        until = "" if until_task >= len(summary.task_names) else f" (until task {until_task})"
        console.print(f"\n[bold]{summary.scenario}[/bold]: success {summary.success}{until}", highlight=False)
        console.print(_tasks(summary, until_task))
        if summary.causes:
            console.print(_causes(summary))
        if summary.figures:
            console.print(_figures(summary))
        console.print(
            f"mean of a run: {summary.mean_simulated_s:.1f} s simulated, {summary.mean_wall_s:.1f} s of real time",
            highlight=False,
        )
    for outcome in outcomes:
        if not outcome.success:
            console.print(f"{outcome.label} seed {outcome.seed}: {outcome.failure}", highlight=False, markup=False)


def _tasks(summary: Summary, until_task: int) -> Table:
    table = Table(title="tasks confirmed by the referee (95 % interval)", title_justify="left")
    for column in ("task", "name", "done"):
        table.add_column(column)
    names = summary.task_names[:until_task]
    for number, (name, share) in enumerate(zip(names, summary.tasks, strict=False), start=1):
        table.add_row(str(number), name, str(share))
    return table


def _causes(summary: Summary) -> Table:
    table = Table(title="causes of failure", title_justify="left")
    for column in ("task", "cause", "runs", "seeds"):
        table.add_column(column)
    for cause in summary.causes:
        task = "-" if cause.task is None else f"{cause.task} {summary.task_names[cause.task - 1]}"
        table.add_row(task, cause.cause, str(len(cause.seeds)), " ".join(map(str, cause.seeds)))
    return table


def _figures(summary: Summary) -> Table:
    table = Table(title="the referee's figures over all runs", title_justify="left")
    for column in ("figure", "least", "median", "most"):
        table.add_column(column)
    for spread in summary.figures:
        table.add_row(spread.name, *(f"{value:.2f}" for value in (spread.least, spread.median, spread.most)))
    return table
