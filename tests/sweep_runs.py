"""Runs for tests of sweeps, in a module of their own: the processes of a sweep import them by its name."""

import os
import time
from pathlib import Path

from preshape.sim_backend.referee_report import TASK_NAMES
from preshape.tools.sweep_run import THREAD_VARIABLES, Figures, RunCase, RunOutcome

RAISES, DIES = 3, 5
WAITING_PLACE = "SWEEP_WAITING_PLACE"
"""The environment's name of the folder in which `waiting_run` writes down its process."""


def figures(slip_mm: float) -> Figures:
    """Return figures of a run in which the box slid so far."""
    return Figures(
        hold_slip_mm=slip_mm, regrasp_motion_mm=1.0, max_torque_ratio=0.9, torn_fraction=1.0, lid_angle_deg=100.0
    )


def run_outcome(
    seed: int, task: int | None = None, cause: str | None = None, name: str = "one", slip_mm: float | None = None
) -> RunOutcome:
    done = 5 if cause is None else (task or 1) - 1
    return RunOutcome(
        scenario=name,
        seed=seed,
        success=cause is None,
        failure=None if cause is None else f"task {task}: {cause}",
        failed_task=task,
        cause=cause,
        task_names=tuple(TASK_NAMES.values()),
        tasks_done=tuple(number < done for number in range(5)),
        attempts=(1,) * 5,
        simulated_s=10.0 + seed,
        figures=None if slip_mm is None else figures(slip_mm),
    )


def fake_run(case: RunCase) -> RunOutcome:
    """Fail by the seed: even ones succeed, odd ones slip."""
    return run_outcome(case.seed, *((4, "slipped: the left hand") if case.seed % 2 else ()), name=case.scenario.name)


def rough_run(case: RunCase) -> RunOutcome:
    """Raise for one seed, take the process down for another."""
    if case.seed == RAISES:
        raise RuntimeError("no such thing")
    if case.seed == DIES:
        os._exit(17)
    return fake_run(case)


def threads_seen(case: RunCase) -> RunOutcome:
    """Report what the numerical libraries of this process are told."""
    return run_outcome(case.seed, 1, ",".join(os.environ.get(variable, "unset") for variable in THREAD_VARIABLES))


def waiting_run(case: RunCase) -> RunOutcome:
    """Write down which process this is, and wait for a minute."""
    Path(os.environ[WAITING_PLACE], str(os.getpid())).touch()
    time.sleep(60.0)
    return run_outcome(case.seed)
