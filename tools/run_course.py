"""One run as the controller's side saw it, and the report made of it and of the referee's verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from preshape import __version__
from preshape.control.loop import ControlLoop
from preshape.control.loop_result import LoopOutcome, LoopResult
from preshape.control.observer import Observers
from preshape.control.procedure_control import ProcedureControl
from preshape.control.timing import Percentiles
from preshape.sim_backend.judged import judged
from preshape.sim_backend.scenario import Scenario
from preshape.tools.exit_codes import ExitCode
from preshape.tools.report import (
    SCHEMA,
    LoopReport,
    PlanReport,
    Report,
    SimReport,
    TaskReport,
    WireReport,
    loop_report,
    referee_report,
)
from preshape.tools.run_ended import Ended, Lost
from preshape.tools.run_failure import lost_failure, name_failure, wire_failure
from preshape.tools.run_options import RunOptions


@dataclass(slots=True, eq=False)
class Course:
    """What the controller's side knows when a run is over; `error` says why there is no result, `where` more."""

    controller: ProcedureControl
    loop: ControlLoop
    start_s: float
    wall_s: float = 0.0
    result: LoopResult | None = None
    error: str | None = None
    where: str = ""
    empty: Percentiles | None = None
    held: int = 0


def run_report(
    drawn: Scenario,
    options: RunOptions,
    course: Course,
    ended: Ended | Lost,
    plan: PlanReport,
    watching: Observers,
    wire: WireReport | None = None,
) -> Report:
    """Return the report of a run of a drawn scenario; task times count from the loop's start."""
    controller, result = course.controller, course.result
    verdict = None if isinstance(ended, Lost) else ended.verdict
    work = controller.work
    names = judged(drawn.shape).names
    name = names[work.task]
    if isinstance(ended, Lost):
        failure = lost_failure(ended.how, result, work.task, name, work.phase, course.error)
    else:
        failure = name_failure(ended.verdict, result, work.task, controller.failure, course.error)
    failure = wire_failure(failure, {} if wire is None else wire.broken, work.task, name)
    return Report(
        schema=SCHEMA,
        version=__version__,
        device=options.device,
        paced=options.in_real_time,
        seed=drawn.seed,
        scenario=drawn,
        success=failure is None,
        failure=None if failure is None else str(failure),
        failed_task=None if failure is None else failure.task,
        cause=None if failure is None else failure.cause,
        tasks=_tasks(course, ended, names),
        plan=plan,
        commands_sha256="" if result is None else result.commands_sha256,
        referee=None if verdict is None else referee_report(verdict),
        loop=_loop_report(course),
        sim=_sim_report(course, ended),
        controller_failure=controller.failure,
        notes=[*work.notes, *([course.where] if course.where else [])],
        observer_failures=[f"{name}: {type(error).__name__}: {error}" for name, error in watching.failures],
        wire=wire,
    )


def _sim_report(course: Course, ended: Ended | Lost) -> SimReport:
    factor = ended.simulated_s / course.wall_s if course.wall_s else 0.0
    if isinstance(ended, Lost):
        return SimReport(seconds=ended.simulated_s, realtime_factor=factor)
    kicks = list(ended.kicks)
    return SimReport(seconds=ended.simulated_s, realtime_factor=factor, slipped_s=ended.slipped_s, kicks=kicks)


def _loop_report(course: Course) -> LoopReport:
    result = course.result
    return loop_report(
        course.loop.timing.report(),
        outcome="not run" if result is None else result.outcome.value,
        reason=course.error or "" if result is None else result.reason,
        refused=0 if result is None else result.refused,
        held=course.held,
        empty_lateness_us=course.empty,
    )


def _tasks(course: Course, ended: Ended | Lost, names: Mapping[int, str]) -> list[TaskReport]:
    seen = None if isinstance(ended, Lost) else {task.task for task in ended.verdict.tasks if task.done}
    reports: list[TaskReport] = []
    for log in course.controller.tasks:
        outcome = log.outcome
        if outcome == "done" and seen is None:
            outcome = "not judged"
        elif outcome == "done" and seen is not None and log.task not in seen:
            outcome = "not confirmed by the referee"
        elif outcome == "running":
            outcome = "interrupted"
        # A task that was interrupted has lasted until the end.
        last_s = course.start_s + ended.simulated_s if outcome == "interrupted" else log.end_s
        times = (max(0.0, time_s - course.start_s) if log.attempts else 0.0 for time_s in (log.start_s, last_s))
        start_s, end_s = times
        reports.append(
            TaskReport(
                task=log.task,
                name=names[log.task],
                outcome=outcome,
                start_s=start_s,
                end_s=end_s,
                attempts=log.attempts,
            )
        )
    return reports


def exit_code(report: Report, course: Course) -> ExitCode:
    """Return the exit code: a world that was lost, then a stop, count more than what the referee has seen."""
    if report.referee is None:
        return ExitCode.UNREACHABLE
    stopped = course.result is not None and course.result.outcome in (LoopOutcome.SAFETY_STOP, LoopOutcome.STOPPED)
    if stopped:
        return ExitCode.SAFETY_STOP
    return ExitCode.DONE if report.success else ExitCode.TASK_FAILED
