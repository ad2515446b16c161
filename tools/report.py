"""`report.json`, schema `preshape/report/1`: what came of one run, as strict values."""

from __future__ import annotations

from typing import Literal

import msgspec

from preshape.control.timing import Percentiles, TimingReport
from preshape.sim_backend.referee_report import Contact, TaskTruth, Verdict
from preshape.sim_backend.scenario import Scenario

SCHEMA = "preshape/report/1"


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every object in a report: frozen, keyword-only, unknown keys refused."""


class TaskReport(Part, frozen=True):
    """One task: the controller's times (s since the start) and attempts; `done` only if the referee agrees."""

    task: int
    name: str
    outcome: str
    start_s: float
    end_s: float
    attempts: int


class GripReport(Part, frozen=True):
    """How a hand held the box: the kind of grip, the face in its palm, the face under its fingers."""

    name: str
    palm: str
    fingers: str


class PlanReport(Part, frozen=True):
    """What was planned: priorities as in eq. (3), the components left to each grasp and the one taken."""

    time_ms: float
    priorities: dict[str, list[int | None]]
    components: dict[str, list[str]]
    chosen: dict[str, str]
    grips: dict[str, GripReport]


class RefereeReport(Part, frozen=True):
    """`preshape.sim_backend.referee_report.Verdict`, which explains the fields."""

    success: bool
    failures: list[str]
    undesired_contacts: list[Contact]
    self_contacts: list[Contact]
    desired_contacts_made: dict[str, bool]
    dropped: bool
    crushed: bool
    max_torque_ratio: float
    max_torque_joint: str
    peak_torque_ratio: float
    max_commanded_ratio: float
    hold_slip_mm: float
    worst_link_slip_mm: float
    regrasp_motion_mm: float
    max_panel_load_n: dict[str, float]
    tab_angle_deg: float
    max_tab_angle_deg: float
    lid_angle_deg: float
    max_lid_angle_deg: float
    tab_torn: bool
    torn_fraction: float
    opening_error: tuple[float, float] | None
    tasks: list[TaskTruth]
    events: dict[str, float]
    until_task: int


class Spread(Part, frozen=True):
    """A distribution, us."""

    p50: float
    p99: float
    p99_9: float
    max: float


class LoopReport(Part, frozen=True):
    """How the loop kept its time and how it ended.

    `refused`: commands that the device did not take; `held`: ticks of a paced loop that repeated the last setpoint
    because the controller was planning; `empty_lateness_us`: of a paced loop without work, measured just before.
    """

    rate_hz: float
    ticks: int
    overruns: int
    compute_us: Spread
    lateness_us: Spread
    outcome: str
    reason: str
    refused: int = 0
    held: int = 0
    empty_lateness_us: Spread | None = None


class SimReport(Part, frozen=True):
    """Simulated time; `slipped_s`: time by which a paced scene stood still; `kicks`: disturbances given (task, s)."""

    seconds: float
    realtime_factor: float
    slipped_s: float = 0.0
    kicks: list[tuple[int, float]] = msgspec.field(default_factory=list[tuple[int, float]])


class FaultReport(Part, frozen=True):
    """What was made to go wrong on the buses: as asked for, how many frames met what, and events with their times (s).

    `injected` counts `frames` that met the faults, what was drawn for how many, and those `lost` on a dead bus.
    """

    faults: str
    injected: dict[str, int]
    happened: list[tuple[float, str]]


class WireReport(Part, frozen=True):
    """What the passive monitor heard on the buses (`preshape.tools.wire_monitor.WireVerdict`, which explains it).

    `ok`: no rule of the wire was broken; `faults` is None where none were asked for.
    """

    ok: bool
    broken: dict[str, int]
    violations: list[str]
    frames: dict[str, int]
    damaged: int
    unknown: dict[str, int]
    errors: int
    torque_limit_ratio: float
    speed_ratio: float
    torque_ratio: float
    faults: FaultReport | None = None


class Report(Part, frozen=True):
    """All of `report.json`; `success` is the referee's and `failure` names what kept it from being one.

    `failed_task` and `cause` split the failure; `observer_failures` tells which observers gave up, and why. `wire` is
    there where the joints hang on buses: a run that breaks a rule of the wire is no success. `referee` is None where
    the world was lost before the referee could speak.
    """

    schema: Literal["preshape/report/1"]
    version: str
    device: str
    paced: bool
    seed: int
    scenario: Scenario
    success: bool
    failure: str | None
    failed_task: int | None
    cause: str | None
    tasks: list[TaskReport]
    plan: PlanReport
    commands_sha256: str
    referee: RefereeReport | None
    loop: LoopReport
    sim: SimReport
    controller_failure: str | None
    notes: list[str]
    observer_failures: list[str]
    wire: WireReport | None = None

    @property
    def done(self) -> str:
        """What a success has brought about, in words."""
        from preshape.sim_backend.judged import judged

        last = sum(task.outcome != "not asked" for task in self.tasks)
        if last == len(self.tasks):
            return judged(self.scenario.shape).achieved
        return "task 1 is done" if last == 1 else f"tasks 1 to {last} are done"


def referee_report(verdict: Verdict) -> RefereeReport:
    """Return the referee's part; `ValidationError` when the verdict has fields that the report does not know."""
    return msgspec.convert(verdict.as_dict(), RefereeReport, strict=True)


def loop_report(
    timing: TimingReport, outcome: str, reason: str, refused: int, held: int, empty_lateness_us: Percentiles | None
) -> LoopReport:
    """Return the loop's part."""
    return LoopReport(
        rate_hz=timing.rate_hz,
        ticks=timing.ticks,
        overruns=timing.overruns,
        compute_us=_spread(timing.compute_us),
        lateness_us=_spread(timing.lateness_us),
        outcome=outcome,
        reason=reason,
        refused=refused,
        held=held,
        empty_lateness_us=None if empty_lateness_us is None else _spread(empty_lateness_us),
    )


def _spread(percentiles: Percentiles) -> Spread:
    return msgspec.convert(percentiles, Spread, from_attributes=True)


def encode_report(report: Report) -> bytes:
    """Return a report as indented JSON."""
    return msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n"


def decode_report(data: bytes) -> Report:
    """Return the report in JSON data; `msgspec.ValidationError` names what is not in the schema."""
    return msgspec.json.decode(data, type=Report)
