"""What a loop in real time asks of the machine, and what the machine gives an empty one."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator, Set
from contextlib import contextmanager, suppress

from preshape.control.timing import LoopTiming, Percentiles
from preshape.hal.clock import Clock
from preshape.sim_backend.physics_core import physics_core

LOOP_PRIORITY = 15
"""First-in-first-out priority of the loop's thread; the physics process has a higher one."""
THINKING_PRIORITY = 10
PLANNING_NICENESS = -5
"""Of a thread that plans: it holds the interpreter's lock at times, and a loop that wants it waits for as long as
another process keeps it from running. More of it takes the machine from what carries the loop's messages."""
SWITCH_S = 1e-4
"""How long one Python thread may keep the others from running, s."""
CORES = frozenset(os.sched_getaffinity(0))
"""Those that this process may use; each of its threads may keep to some of them."""


def take_priority(priority: int, thread: int = 0, cores: Set[int] = CORES) -> None:
    """Schedule a thread (by its native id; 0: the calling one) first in, first out, if the machine lets us.

    It keeps off the core that physics has. Not on a machine of one core, where it would keep the physics and the
    modules from running.
    """
    core = physics_core(cores)
    if core is None:
        return
    with suppress(PermissionError, ProcessLookupError):
        os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))
        os.sched_setaffinity(thread, cores - {core})


def give_up_priority(thread: int, cores: Set[int] = CORES) -> None:
    """Let a thread share the machine with others, though with more of it than those, if the machine lets us."""
    if physics_core(cores) is None:
        return
    with suppress(PermissionError, ProcessLookupError):
        os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(thread, cores)
        os.setpriority(os.PRIO_PROCESS, thread, PLANNING_NICENESS)


@contextmanager
def real_time(anywhere: bool = False) -> Generator[None]:
    """Run the calling thread with priority over the machine's other work, and switch threads often.

    `anywhere`: what it starts meanwhile may run on any core.
    """
    policy, parameters, switch_s = os.sched_getscheduler(0), os.sched_getparam(0), sys.getswitchinterval()
    cores = os.sched_getaffinity(0)
    take_priority(LOOP_PRIORITY)
    if anywhere:
        os.sched_setaffinity(0, cores)
    sys.setswitchinterval(SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(switch_s)
        os.sched_setaffinity(0, cores)
        with suppress(PermissionError):
            os.sched_setscheduler(0, policy, parameters)


def empty_lateness(clock: Clock, period_ns: int, ticks: int) -> Percentiles:
    """Return how late a loop that does nothing wakes up."""
    timing = LoopTiming(period_ns, ticks)
    deadline_ns = clock.now_ns()
    for _ in range(ticks):
        deadline_ns += period_ns
        clock.sleep_until_ns(deadline_ns)
        timing.add(max(0, clock.now_ns() - deadline_ns), 0)
    return timing.report().lateness_us
