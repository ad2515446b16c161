"""Before a run in real time: every kernel ready, if need be by a rehearsal of the same run in lockstep."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

from preshape.hal.kernel_cache import KERNELS, PACKAGE_ROOT, cache_root
from preshape.hal.kernel_warm_up import warm_up
from preshape.hal.source_digest import source_digest
from preshape.sim_backend.scenario import Scenario
from preshape.tools.run_options import TASKS, RunOptions


def prepare_kernels(scenario: Scenario, seed: int, options: RunOptions) -> bool:
    """Make every kernel ready that the run will call; return whether it took a rehearsal.

    The rehearsal is the same run in lockstep, in a process of its own, about a minute; later runs of this version
    that go no further need none. Where kernels cannot be kept, it is done in this process, each time.
    """
    root = cache_root()
    if root is None or not KERNELS:
        _rehearse(scenario, seed, options)
        return True
    version = source_digest(PACKAGE_ROOT / "tools" / "session.py", PACKAGE_ROOT)
    marks = [root / f"rehearsed-{version}-{scenario.shape}-{task}" for task in range(options.until_task, TASKS + 1)]
    rehearsed = any(mark.exists() for mark in marks)
    if not rehearsed:
        with ProcessPoolExecutor(max_workers=1, mp_context=multiprocessing.get_context("spawn")) as pool:
            pool.submit(_rehearse, scenario, seed, options).result()
        marks[0].touch()
    warm_up()
    return not rehearsed


def _rehearse(scenario: Scenario, seed: int, options: RunOptions) -> None:
    from preshape.tools.session import run_session

    asked = {name: getattr(options, name) for name in ("field", "ties", "norm", "until_task")}
    run_session(scenario, seed, RunOptions(**asked, record=False, pictures=False))
