"""What a loop in real time asks of the machine, and what the machine gives an empty one."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress

from preshape.control.timing import LoopTiming, Percentiles
from preshape.hal.clock import Clock
from preshape.sim_backend.paced_layout import PHYSICS

LOOP_PRIORITY = 15
"""First-in-first-out priority of the loop's thread; the physics process has a higher one."""
THINKING_PRIORITY = 10
PLANNING_NICENESS = -5
"""Of a thread that plans: it holds the interpreter's lock at times, and a loop that wants it waits for as long as
another process keeps it from running. More of it takes the machine from what carries the loop's messages."""
SWITCH_S = 1e-4
"""How long one Python thread may keep the others from running, s."""
CORES = frozenset(os.sched_getaffinity(0))
"""Those that this process may use; threads of it may keep to some of them."""


def take_priority(priority: int, thread: int = 0) -> None:
    """Schedule a thread (by its native id; 0: the calling one) first in, first out, if the machine lets us.

    Not on a machine of one core, where it would keep the physics and the modules from running.
    """
    if _one_core():
        return
    with suppress(PermissionError, ProcessLookupError):
        os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))


def _one_core() -> bool:
    return len(CORES) == 1


def give_up_priority(thread: int) -> None:
    """Let a thread share the machine with others, though with more of it than those, if the machine lets us."""
    if _one_core():
        return
    with suppress(PermissionError, ProcessLookupError):
        os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
        os.setpriority(os.PRIO_PROCESS, thread, PLANNING_NICENESS)


@contextmanager
def real_time() -> Generator[None]:
    """Run the calling thread with priority over the machine's other work, and switch threads often."""
    policy, parameters, switch_s = os.sched_getscheduler(0), os.sched_getparam(0), sys.getswitchinterval()
    take_priority(LOOP_PRIORITY)
    sys.setswitchinterval(SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(switch_s)
        with suppress(PermissionError):
            os.sched_setscheduler(0, policy, parameters)


@contextmanager
def cores_apart() -> Generator[None]:
    """Keep the physics process that this one has started to a core, and the calling thread and its threads off it.

    A kernel keeps from running for up to 50 ms what has taken 95 % of a core for a second by real-time priority.
    Physics and a loop that come to share a core take that much together. Where others take their part of the cores
    in real time, as a server does, nothing is bound: whoever is ready takes the core that is free.
    """
    physics = [child.pid for child in multiprocessing.active_children() if child.name == PHYSICS]
    if len(physics) != 1 or physics[0] is None or _one_core():
        yield
        return
    core = max(CORES)
    with suppress(ProcessLookupError):
        os.sched_setaffinity(physics[0], {core})
    os.sched_setaffinity(0, CORES - {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, CORES)


def empty_lateness(clock: Clock, period_ns: int, ticks: int) -> Percentiles:
    """Return how late a loop that does nothing wakes up."""
    timing = LoopTiming(period_ns, ticks)
    deadline_ns = clock.now_ns()
    for _ in range(ticks):
        deadline_ns += period_ns
        clock.sleep_until_ns(deadline_ns)
        timing.add(max(0, clock.now_ns() - deadline_ns), 0)
    return timing.report().lateness_us
