"""One run: the one place that chooses a world, builds controller, gate, loop and observers, and gathers the outcome."""

from __future__ import annotations

import time
import traceback
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from preshape.control.loop import ControlLoop
from preshape.control.loop_result import LoopResult
from preshape.control.observer import Observer, Observers
from preshape.control.work import Work
from preshape.hal.clock import Clock, MonotonicClock
from preshape.hal.device import DeviceUnreachable
from preshape.hal.gate import SafetyGate
from preshape.hal.kernel_warm_up import remember_signatures
from preshape.hal.recorded_perception import Listener, RecordedPerception
from preshape.sim_backend.device import MujocoDevice
from preshape.sim_backend.lockstep import SimClock
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import initial_box_pose, nominal_box, workcell
from preshape.sim_backend.scene_perception import attach_sensors
from preshape.sim_backend.sensors import SceneSensors
from preshape.sim_backend.simulation import Simulation
from preshape.tools.can_setup import can_setup
from preshape.tools.controller_setup import ControllerSetup, setup_of
from preshape.tools.evidence import Evidence
from preshape.tools.feasibility import impossibility
from preshape.tools.lift_plan import lift_drawing, lift_report
from preshape.tools.parts_observer import PartsObserver
from preshape.tools.patient import PATIENT_PERIODS, PatientController
from preshape.tools.plan_drawing import PlanDrawing
from preshape.tools.real_time import cores_apart, empty_lateness, real_time
from preshape.tools.recorder import Recorder
from preshape.tools.rehearsal import prepare_kernels
from preshape.tools.report import PlanReport
from preshape.tools.run_course import Course, exit_code, run_report
from preshape.tools.run_ended import Ended, Lost
from preshape.tools.run_options import RunOptions
from preshape.tools.run_plan import plan_drawing, plan_report, plan_run
from preshape.tools.run_result import RunResult
from preshape.tools.run_world import RunWorld, open_world, require_reachable
from preshape.tools.standby import await_start
from preshape.tools.stop_signals import StopSignals
from preshape.tools.telemetry import Telemetry
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.telemetry_scene import scene_info
from preshape.tools.wire_watch import WireWatch

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


def run_session(
    scenario: Scenario,
    seed: int,
    options: RunOptions | None = None,
    observers: Sequence[Observer] = (),
    telemetry: TelemetryConfig | None = None,
    bus_log: Path | None = None,
    recorder: Recorder | None = None,
    signals: StopSignals | None = None,
) -> RunResult:
    """Carry out the procedure in the world that `seed` draws from a scenario.

    Nothing is written to disk but what a `recorder` keeps, and the frames of a CAN world's buses, to the file
    `bus_log` if there is one.
    `observers` are told of every tick besides those that the options ask for; with `telemetry` the run goes out over
    Zenoh, and a stop that is asked for there is obeyed; so is one by `signals`. What nobody could do is a failure
    before anything moves. An exception of the controller is a failure with its text; the loop has stopped the device
    then.

    Raises:
        DeviceUnreachable: the world, or the telemetry, could not be opened. One that is lost later is a failure.
    """
    options = options or RunOptions()
    drawn = scenario.drawn(seed)
    evidence = Evidence()
    watching = Observers(observers)
    cause = impossibility(workcell(drawn), nominal_box(drawn), initial_box_pose(drawn))
    asked = options if cause is None else RunOptions()
    if asked.in_real_time:
        require_reachable(asked)
        prepare_kernels(scenario, seed, asked)
    wire = _wire_watch(asked, drawn.seed)
    if recorder is not None and cause is None:
        recorder.start(asked.in_real_time, buses=asked.device == "can")
    with _telemetry(telemetry, drawn, options) as live, open_world(drawn, asked, bus_log, wire) as world:
        if live is not None and live.waits_for_start:
            options = await_start(live.orders, options)
        setup = setup_of(drawn, options)
        listeners = [part.hear for part in (recorder, live) if part is not None]
        course = _prepare(world, setup, watching, listeners)
        if live is not None:
            live.watch(course.loop, watching)
        if wire is not None:
            watching.add(wire)
        if cause is not None:
            course.controller.work.task, course.error = cause
        else:
            if options.record:
                watching.add(evidence.keep_ticks())
            if options.pictures:
                watching.add(evidence.keep_pictures(world.scene_positions))
            if recorder is not None:
                recorder.begin(setup)
                watching.add(recorder)
            told = [part.parts for part in (live, recorder) if part is not None and part.parts is not None]
            if told and asked.device == "can":
                watching.add(PartsObserver(told, world.device, options.loop_rate_hz))
            if signals is not None:
                signals.obey(course.loop)
            _run(course, world.clock, options.in_real_time)
        finished = _finish(world, course)
        parts = [part.note for part in (live, recorder) if part is not None]
        course.controller.work.notes += [note for note in parts if note]
    remember_signatures()
    ended = _asked_for(finished, options.until_task)
    plan, drawing = _plan(drawn, course.controller.work, options.pictures and cause is None)
    heard = None if wire is None else wire.report()
    report = run_report(drawn, options, course, ended, plan, watching, heard)
    evidence.plan = drawing
    kept = evidence if evidence.ticks or evidence.storyboard else None
    return RunResult(drawn, report, exit_code(report, course), kept)


def _finish(world: RunWorld, course: Course) -> Ended | Lost:
    """Return what the world knows of the run; a world in real time has had its own time before the run began."""
    lasted_s = max(0.0, world.clock.now_ns() * 1e-9 - course.start_s)
    try:
        ended = world.finish()
    except DeviceUnreachable as error:
        return Lost(str(error), lasted_s)
    return replace(ended, simulated_s=min(ended.simulated_s, lasted_s))


def _asked_for(ended: Ended | Lost, until_task: int) -> Ended | Lost:
    """Return the end of a run that is judged on the tasks up to one only."""
    if isinstance(ended, Lost):
        return ended
    until_task = min(until_task, len(ended.verdict.tasks))
    return replace(ended, verdict=replace(ended.verdict, until_task=until_task))


def _wire_watch(options: RunOptions, seed: int) -> WireWatch | None:
    """Return what listens to the buses, where there are any and they are in this process."""
    if options.device != "can" or options.in_real_time:
        return None
    topology = can_setup(options).topology
    return WireWatch(options.faults, topology, 1.0 / options.loop_rate_hz, seed, options.patience)


def _telemetry(
    config: TelemetryConfig | None, drawn: Scenario, options: RunOptions
) -> AbstractContextManager[Telemetry | None]:
    if config is None:
        return nullcontext()
    cell, box = workcell(drawn), nominal_box(drawn)
    rate_hz = float(options.loop_rate_hz)
    return Telemetry(config, options.device, options.in_real_time, rate_hz, cell.X_world_base, scene_info(cell, box))


def _plan(drawn: Scenario, work: Work, draw: bool) -> tuple[PlanReport, PlanDrawing | None]:
    """Return the plan of a run as it is reported, and drawn if asked."""
    if drawn.shape != "box":
        return lift_report(work.plan), lift_drawing(drawn, work.plan) if draw else None
    plan = plan_run(work.box, work.opening, work.grips)
    return plan_report(plan), plan_drawing(plan) if draw else None


def _prepare(world: RunWorld, setup: ControllerSetup, observer: Observer, listeners: Sequence[Listener]) -> Course:
    perception = RecordedPerception(world.perception, *listeners) if listeners else world.perception
    controller = setup.controller(perception, world.report_opening)
    gate = SafetyGate(setup.gate)
    loop = ControlLoop(world.device, world.clock, gate, observer, time.perf_counter_ns, setup.loop)
    return Course(controller, loop, world.clock.now_ns() * 1e-9)


def _run(course: Course, clock: Clock, paced: bool) -> None:
    started = time.perf_counter()
    try:
        course.result = _run_paced(course, clock) if paced else course.loop.run(course.controller)
    except (ArithmeticError, AssertionError, LookupError, RuntimeError, TypeError, ValueError) as error:
        course.error = f"error: {type(error).__name__}: {error}"
        course.where = traceback.format_exc(limit=-3)
    course.wall_s = time.perf_counter() - started


def _run_paced(course: Course, clock: Clock) -> LoopResult:
    period_s = course.loop.period_ns * 1e-9 / (clock.pace if isinstance(clock, MonotonicClock) else 1.0)
    tick_s = 1.0 / course.loop.config.rate_hz
    patient = PatientController(course.controller, PATIENT_PERIODS * period_s, tick_s)
    with cores_apart(), patient, real_time():
        course.empty = empty_lateness(clock, course.loop.period_ns, EMPTY_TICKS)
        course.start_s = clock.now_ns() * 1e-9
        try:
            return course.loop.run(patient)
        finally:
            course.held = patient.held
