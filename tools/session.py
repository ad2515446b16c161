"""One run: the one place that chooses a world, builds controller, gate, loop and observers, and gathers the outcome."""

from __future__ import annotations

import signal
import threading
import time
import traceback
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from preshape import __version__
from preshape.control.box_opening import BoxOpening
from preshape.control.field import FieldOptions
from preshape.control.loop import ControlLoop
from preshape.control.loop_result import LoopConfig, LoopOutcome, LoopResult
from preshape.control.observer import Observer, Observers
from preshape.control.timing import Percentiles
from preshape.hal.clock import Clock
from preshape.hal.gate import SafetyGate
from preshape.sim_backend.device import MujocoDevice
from preshape.sim_backend.lockstep import SimClock
from preshape.sim_backend.referee_report import TASK_NAMES
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import initial_box_pose, nominal_box, workcell
from preshape.sim_backend.scene_perception import attach_sensors
from preshape.sim_backend.sensors import SceneSensors
from preshape.sim_backend.simulation import Simulation
from preshape.sim_backend.texture import texture_library
from preshape.tools.evidence import Evidence
from preshape.tools.exit_codes import ExitCode
from preshape.tools.feasibility import impossibility
from preshape.tools.patient import PatientController
from preshape.tools.real_time import empty_lateness, real_time
from preshape.tools.report import SCHEMA, LoopReport, Report, SimReport, TaskReport, loop_report, referee_report
from preshape.tools.run_failure import name_failure
from preshape.tools.run_options import RunOptions
from preshape.tools.run_plan import report_plan
from preshape.tools.run_result import RunResult
from preshape.tools.run_world import Ended, RunWorld, open_world

RATE_HZ = 500.0
EMPTY_TICKS = 500
"""Ticks of the empty loop that a paced run is measured beside."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A lockstep world without a referee, to be looked into."""

    simulation: Simulation
    sensors: SceneSensors
    device: MujocoDevice
    clock: SimClock


def build_world(drawn: Scenario) -> World:
    """Return the simulation of a drawn scenario with its camera and pose sensor recording."""
    simulation = Simulation(drawn)
    return World(simulation, attach_sensors(simulation), MujocoDevice(simulation), SimClock(simulation))


@dataclass(slots=True, eq=False)
class _Course:
    """What the controller's side knows when a run is over; `error` says why there is no result, `where` more."""

    controller: BoxOpening
    loop: ControlLoop
    start_s: float
    wall_s: float = 0.0
    result: LoopResult | None = None
    error: str | None = None
    where: str = ""
    empty: Percentiles | None = None
    held: int = 0


def run_session(
    scenario: Scenario, seed: int, options: RunOptions | None = None, observers: Sequence[Observer] = ()
) -> RunResult:
    """Carry out the procedure in the world that `seed` draws from a scenario; nothing is written to disk.

    `observers` are told of every tick besides those that the options ask for. What nobody could do is a failure
    before anything moves. An exception of the controller is a failure with its text; the loop has stopped the
    device then.

    Raises:
        DeviceUnreachable: the world could not be opened, or was lost.
    """
    options = options or RunOptions()
    drawn = scenario.drawn(seed)
    evidence = Evidence()
    watching = Observers(observers)
    cause = impossibility(workcell(drawn), nominal_box(drawn), initial_box_pose(drawn))
    with open_world(drawn, options.paced and cause is None) as world:
        course = _prepare(world, drawn, options, watching)
        if cause is not None:
            course.controller.work.task, course.error = cause
        else:
            if options.record:
                watching.add(evidence.keep_records(workcell(drawn), nominal_box(drawn)))
            if options.pictures:
                watching.add(evidence.keep_pictures(world.scene_positions))
            _run(course, world.clock, options.paced)
        ended = world.finish()
    report = _report(drawn, options, course, ended, watching)
    kept = evidence if evidence.recording or evidence.storyboard else None
    return RunResult(drawn, report, _exit_code(report, course), kept)


def _controller(world: RunWorld, drawn: Scenario, options: RunOptions) -> BoxOpening:
    opening = drawn.opening
    return BoxOpening(
        workcell(drawn),
        nominal_box(drawn),
        texture_library(opening.tab_length_m, opening.tab_depth_m),
        world.perception,
        1.0 / RATE_HZ,
        FieldOptions(norm=options.norm, ties=options.ties, mode=options.field),
        world.report_opening,
    )


def _prepare(world: RunWorld, drawn: Scenario, options: RunOptions, observer: Observer) -> _Course:
    controller = _controller(world, drawn, options)
    config = LoopConfig(rate_hz=RATE_HZ, max_ticks=round(options.time_limit_s * RATE_HZ))
    loop = ControlLoop(world.device, world.clock, SafetyGate(), observer, time.perf_counter_ns, config)
    return _Course(controller, loop, world.clock.now_ns() * 1e-9)


def _run(course: _Course, clock: Clock, paced: bool) -> None:
    started = time.perf_counter()
    with _stopped_by_interrupt(course.loop):
        try:
            course.result = _run_paced(course, clock) if paced else course.loop.run(course.controller)
        except (ArithmeticError, AssertionError, LookupError, RuntimeError, TypeError, ValueError) as error:
            course.error = f"error: {type(error).__name__}: {error}"
            course.where = traceback.format_exc(limit=-3)
    course.wall_s = time.perf_counter() - started


def _run_paced(course: _Course, clock: Clock) -> LoopResult:
    with PatientController(course.controller) as patient, real_time():
        course.empty = empty_lateness(clock, course.loop.period_ns, EMPTY_TICKS)
        course.start_s = clock.now_ns() * 1e-9
        try:
            return course.loop.run(patient)
        finally:
            course.held = patient.held


@contextmanager
def _stopped_by_interrupt(loop: ControlLoop) -> Generator[None]:
    """Let the first interrupt from the keyboard ask the loop for a braked stop; the second one ends the program."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, before)
        loop.request_stop("interrupted from the keyboard")

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _report(drawn: Scenario, options: RunOptions, course: _Course, ended: Ended, watching: Observers) -> Report:
    controller, verdict, result = course.controller, ended.verdict, course.result
    work = controller.work
    failure = name_failure(verdict, result, work.task, controller.failure, course.error)
    return Report(
        schema=SCHEMA,
        version=__version__,
        device=options.device,
        paced=options.paced,
        seed=drawn.seed,
        scenario=drawn,
        success=verdict.success,
        failure=None if failure is None else str(failure),
        failed_task=None if failure is None else failure.task,
        cause=None if failure is None else failure.cause,
        tasks=_tasks(course, ended),
        plan=report_plan(work.box, work.opening, work.grips),
        commands_sha256="" if result is None else result.commands_sha256,
        referee=referee_report(verdict),
        loop=_loop_report(course),
        sim=SimReport(
            seconds=ended.simulated_s,
            realtime_factor=ended.simulated_s / course.wall_s if course.wall_s else 0.0,
            slipped_s=ended.slipped_s,
            kicks=list(ended.kicks),
        ),
        controller_failure=controller.failure,
        notes=[*work.notes, *([course.where] if course.where else [])],
        observer_failures=[f"{name}: {type(error).__name__}: {error}" for name, error in watching.failures],
    )


def _loop_report(course: _Course) -> LoopReport:
    result = course.result
    return loop_report(
        course.loop.timing.report(),
        outcome="not run" if result is None else result.outcome.value,
        reason=course.error or "" if result is None else result.reason,
        refused=0 if result is None else result.refused,
        held=course.held,
        empty_lateness_us=course.empty,
    )


def _tasks(course: _Course, ended: Ended) -> list[TaskReport]:
    truth = {task.task: task.done for task in ended.verdict.tasks}
    reports: list[TaskReport] = []
    for log in course.controller.tasks:
        outcome = log.outcome
        if outcome == "done" and not truth[log.task]:
            outcome = "not confirmed by the referee"
        elif outcome == "running":
            outcome = "interrupted"
        times = (max(0.0, time_s - course.start_s) if log.attempts else 0.0 for time_s in (log.start_s, log.end_s))
        start_s, end_s = times
        reports.append(
            TaskReport(
                task=log.task,
                name=TASK_NAMES[log.task],
                outcome=outcome,
                start_s=start_s,
                end_s=end_s,
                attempts=log.attempts,
            )
        )
    return reports


def _exit_code(report: Report, course: _Course) -> ExitCode:
    stopped = course.result is not None and course.result.outcome in (LoopOutcome.SAFETY_STOP, LoopOutcome.STOPPED)
    if stopped:
        return ExitCode.SAFETY_STOP
    return ExitCode.DONE if report.success else ExitCode.TASK_FAILED
