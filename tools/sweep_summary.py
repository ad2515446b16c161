"""What the outcomes of a sweep add up to: success, how far runs came, and why they failed."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from preshape.tools.sweep_run import Figures, RunOutcome
from preshape.tools.wilson import Interval, wilson


class Share(msgspec.Struct, frozen=True):
    """So many of so many, with Wilson's 95 % interval of the chance behind it."""

    count: int
    of: int
    interval: Interval

    @staticmethod
    def count_of(outcomes: Sequence[bool]) -> Share:
        """Return the share of true values."""
        return Share(sum(outcomes), len(outcomes), wilson(sum(outcomes), len(outcomes)))

    def __str__(self) -> str:
        low, high = self.interval
        rate = f"{100.0 * self.count / self.of:.0f} %" if self.of else "-"
        return f"{self.count} of {self.of} = {rate} ({100.0 * low:.0f} .. {100.0 * high:.0f} %)"


class Cause(msgspec.Struct, frozen=True):
    """Failures of one class in one task (None: outside of any), with their seeds and one text in full."""

    task: int | None
    cause: str
    seeds: tuple[int, ...]
    example: str


class Spread(msgspec.Struct, frozen=True):
    """One of the referee's figures over all runs that reported it."""

    name: str
    least: float
    median: float
    most: float


class Summary(msgspec.Struct, frozen=True):
    """One scenario of a sweep.

    `tasks`: for each task of `task_names` the share of all runs in which the referee confirms it. `figures`: how near
    the runs, failed ones among them, came to what the referee allows.
    """

    scenario: str
    success: Share
    task_names: tuple[str, ...]
    tasks: tuple[Share, ...]
    causes: tuple[Cause, ...]
    figures: tuple[Spread, ...]
    mean_simulated_s: float
    mean_wall_s: float


def summarise(outcomes: Sequence[RunOutcome]) -> tuple[Summary, ...]:
    """Return one summary per scenario and faults, in the order of appearance; most frequent causes first."""
    labels = dict.fromkeys(outcome.label for outcome in outcomes)
    return tuple(_scenario(label, [outcome for outcome in outcomes if outcome.label == label]) for label in labels)


def _scenario(name: str, outcomes: Sequence[RunOutcome]) -> Summary:
    return Summary(
        name,
        Share.count_of([outcome.success for outcome in outcomes]),
        outcomes[0].task_names,
        tuple(Share.count_of(list(done)) for done in zip(*(outcome.tasks_done for outcome in outcomes), strict=True)),
        causes_of(outcomes),
        figures_of(outcomes),
        sum(outcome.simulated_s for outcome in outcomes) / len(outcomes),
        sum(outcome.wall_s for outcome in outcomes) / len(outcomes),
    )


def causes_of(outcomes: Sequence[RunOutcome]) -> tuple[Cause, ...]:
    """Return the failures by task and class of cause: the frequent first, then by task."""
    groups: dict[tuple[int, str], list[RunOutcome]] = {}
    for outcome in outcomes:
        if not outcome.success:
            groups.setdefault((outcome.failed_task or 0, outcome.cause_class), []).append(outcome)
    ordered = sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))
    return tuple(
        Cause(task or None, cause, tuple(outcome.seed for outcome in group), group[0].failure or "")
        for (task, cause), group in ordered
    )


def figures_of(outcomes: Sequence[RunOutcome]) -> tuple[Spread, ...]:
    """Return least, median and largest value of each of the referee's figures; nothing if no run reported any."""
    kept = [outcome.figures for outcome in outcomes if outcome.figures is not None]
    if not kept:
        return ()
    columns = ((name, [getattr(figures, name) for figures in kept]) for name in Figures.__struct_fields__)
    return tuple(Spread(name, min(values), float(np.median(values)), max(values)) for name, values in columns)
