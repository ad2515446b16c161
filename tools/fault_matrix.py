"""A sweep over faults as a matrix: what became of the box, or which named stop came, for each fault."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table

from preshape.tools.sweep_run import RunOutcome

OPENED = "opened"
UNNAMED = ("exception", "crashed", "error")
"""Classes of causes that are defects, not named stops."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultRow:
    """What one fault led to.

    Attributes:
        label: the scenario and the fault.
        outcomes: how many runs ended how: `OPENED`, or the class of the cause.
        unnamed: how many ended in a defect.
        broken: how often each rule of the wire was broken.
        torque_limit_ratio: largest torque limit commanded on the wire ...
        torque_ratio: ... and largest torque reported there, as shares of the joints' limits; None: no bus.
        physics_ratio: largest torque in physics for longer than the referee allows for, as a share of the limit.
    """

    label: str
    outcomes: Counter[str]
    unnamed: int
    broken: Counter[str]
    torque_limit_ratio: float | None
    torque_ratio: float | None
    physics_ratio: float | None

    @property
    def sound(self) -> bool:
        """Whether every run opened the box or ended in a named stop, and no rule of the wire was broken."""
        return not self.unnamed and not self.broken


def fault_rows(outcomes: Sequence[RunOutcome]) -> list[FaultRow]:
    """Return one row per scenario and fault, in the order in which they first appear."""
    labels = dict.fromkeys(outcome.label for outcome in outcomes)
    return [_row(label, [outcome for outcome in outcomes if outcome.label == label]) for label in labels]


def _row(label: str, outcomes: Sequence[RunOutcome]) -> FaultRow:
    wires = [outcome.wire for outcome in outcomes if outcome.wire is not None]
    broken: Counter[str] = Counter()
    for wire in wires:
        broken.update(wire.broken)
    return FaultRow(
        label=label,
        outcomes=Counter(OPENED if outcome.success else outcome.cause_class for outcome in outcomes),
        unnamed=sum(outcome.cause_class in UNNAMED for outcome in outcomes),
        broken=broken,
        torque_limit_ratio=max((wire.torque_limit_ratio for wire in wires), default=None),
        torque_ratio=max((wire.torque_ratio for wire in wires), default=None),
        physics_ratio=max((run.figures.max_torque_ratio for run in outcomes if run.figures is not None), default=None),
    )


def matrix(rows: Sequence[FaultRow]) -> Table:
    """Return fault x outcome as a table: counts of runs, then what was on the wire and in physics."""
    seen = dict.fromkeys(name for row in rows for name, _ in row.outcomes.most_common() if name != OPENED)
    table = Table(title="fault x outcome (runs); largest torques as shares of the joints' limits", title_justify="left")
    for column in ("fault", OPENED, *seen, "commanded", "reported", "physics", "rules broken"):
        table.add_column(column)
    for row in rows:
        counts = (str(row.outcomes[name] or "-") for name in (OPENED, *seen))
        ratios = (row.torque_limit_ratio, row.torque_ratio, row.physics_ratio)
        shares = ("-" if ratio is None else f"{ratio:.2f}" for ratio in ratios)
        broken = ", ".join(f"{rule} {count}" for rule, count in row.broken.items())
        table.add_row(row.label, *counts, *shares, broken or "none")
    return table
