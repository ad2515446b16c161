"""What a run hands back: its report, its exit code, and what was kept to draw it."""

from __future__ import annotations

from dataclasses import dataclass

from preshape.sim_backend.scenario import Scenario
from preshape.tools.evidence import Evidence
from preshape.tools.exit_codes import ExitCode
from preshape.tools.report import Report


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """The outcome of one run of a drawn scenario; `evidence` is None when nothing was kept."""

    scenario: Scenario
    report: Report
    exit_code: ExitCode
    evidence: Evidence | None = None

    @property
    def success(self) -> bool:
        """Whether the referee calls it a success."""
        return self.report.success

    @property
    def failure(self) -> str | None:
        """What kept it from being a success."""
        return self.report.failure
