"""One run of a sweep, reduced to what is counted; whatever happens in it, an outcome comes back."""

from __future__ import annotations

import multiprocessing
import os
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING

import msgspec

from preshape.sim_backend.judged import judged
from preshape.sim_backend.scenario import Scenario
from preshape.tools.run_options import RunOptions

if TYPE_CHECKING:
    from preshape.tools.report import WireReport

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""What tells the numerical libraries how many threads to start."""


class Figures(msgspec.Struct, frozen=True, kw_only=True):
    """How near a run came to what the referee allows; see `report.json`'s referee."""

    hold_slip_mm: float
    regrasp_motion_mm: float
    max_torque_ratio: float
    torn_fraction: float
    lid_angle_deg: float


class WireFigures(msgspec.Struct, frozen=True, kw_only=True):
    """What the passive monitor says of a run's bus: rules broken, and the largest shares of the joints' limits."""

    broken: dict[str, int]
    torque_limit_ratio: float
    torque_ratio: float


class RunOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """What a sweep keeps of one run.

    `faults` is what went wrong on its bus, as it was asked for; `wire` is None where there was no bus.
    `tasks_done`: for each task of `task_names` whether the referee confirms it. `failed_task` is None for a
    success and for a failure outside of any task (an exception, a crashed process); the words of `cause`
    before its first colon are its class. `simulated_s` and `wall_s` are 0, and `figures` None, where the run did
    not report.
    """

    scenario: str
    seed: int
    success: bool
    failure: str | None
    failed_task: int | None
    cause: str | None
    task_names: tuple[str, ...]
    tasks_done: tuple[bool, ...]
    attempts: tuple[int, ...]
    simulated_s: float = 0.0
    wall_s: float = 0.0
    overruns: int = 0
    commands_sha256: str = ""
    figures: Figures | None = None
    faults: str = ""
    wire: WireFigures | None = None

    @property
    def key(self) -> tuple[str, str, int]:
        """What tells this run from the others of its sweep."""
        return self.scenario, self.faults, self.seed

    @property
    def label(self) -> str:
        """The runs that this one is counted with: its scenario, and the faults if there are any."""
        return f"{self.scenario} with {self.faults}" if self.faults else self.scenario

    @property
    def cause_class(self) -> str:
        """The cause without its particulars."""
        return "" if self.cause is None else self.cause.split(":")[0].strip()


class RunCase(msgspec.Struct, frozen=True):
    """One run to be done: a scenario not yet drawn, its seed, and how."""

    scenario: Scenario
    seed: int
    options: RunOptions

    @property
    def key(self) -> tuple[str, str, int]:
        """What tells this run from the others of its sweep."""
        return self.scenario.name, self.options.faults, self.seed


Run = Callable[[RunCase], RunOutcome]


def run_case(case: RunCase) -> RunOutcome:
    """Carry out one run as `preshape run` does, without files."""
    from preshape.tools.session import run_session

    result = run_session(case.scenario, case.seed, case.options)
    report = result.report
    return RunOutcome(
        scenario=case.scenario.name,
        faults=case.options.faults,
        seed=case.seed,
        success=report.success,
        failure=report.failure,
        failed_task=report.failed_task,
        cause=report.cause,
        task_names=tuple(task.name for task in report.tasks),
        tasks_done=tuple(task.outcome == "done" for task in report.tasks),
        attempts=tuple(task.attempts for task in report.tasks),
        simulated_s=report.sim.seconds,
        overruns=report.loop.overruns,
        commands_sha256=report.commands_sha256,
        wire=None if report.wire is None else _wire_figures(report.wire),
        figures=None if report.referee is None else msgspec.convert(report.referee, Figures, from_attributes=True),
    )


def _wire_figures(wire: WireReport) -> WireFigures:
    return WireFigures(broken=wire.broken, torque_limit_ratio=wire.torque_limit_ratio, torque_ratio=wire.torque_ratio)


def failed(case: RunCase, cause: str) -> RunOutcome:
    """Return the outcome of a run that could not report."""
    names = tuple(judged(case.scenario.shape).names.values())
    return RunOutcome(
        scenario=case.scenario.name,
        faults=case.options.faults,
        seed=case.seed,
        success=False,
        failure=cause,
        failed_task=None,
        cause=cause,
        task_names=names,
        tasks_done=(False,) * len(names),
        attempts=(0,) * len(names),
    )


def guarded(run: Run, case: RunCase) -> RunOutcome:
    """Run; an exception becomes the run's named failure. The process keeps to one thread."""
    limit_threads()
    started = time.perf_counter()
    try:
        outcome = run(case)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        outcome = failed(
            case, f"exception: {type(error).__name__}: {error} ({os.path.basename(where.filename)}:{where.lineno})"
        )
    return msgspec.structs.replace(outcome, wall_s=time.perf_counter() - started)


def alone(run: Run, case: RunCase) -> RunOutcome:
    """Run in a new process of its own, so that its death is a named failure of this run and of no other."""
    with ProcessPoolExecutor(max_workers=1, mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            return pool.submit(guarded, run, case).result()
        except BrokenProcessPool:
            return failed(case, "crashed: the process of this run died")


def limit_threads() -> None:
    """Ask for one thread in this process and its children; libraries that are loaded already keep what they have."""
    for variable in THREAD_VARIABLES:
        os.environ.setdefault(variable, "1")
