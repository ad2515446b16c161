"""Before a run in real time: every kernel ready, if need be by a rehearsal of the same run in lockstep."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from preshape.hal.kernel_cache import KERNELS, cache_root
from preshape.hal.kernel_warm_up import warm_up
from preshape.sim_backend.scenario import Scenario
from preshape.tools.run_options import TASKS, RunOptions


def prepare_kernels(scenario: Scenario, seed: int, options: RunOptions) -> bool:
    """Make every kernel ready that the run will call; return whether it took a rehearsal.

    The rehearsal is the same run in lockstep, in a process of its own, about a minute. It is done once, and again
    after a kernel that it called has changed. Where kernels cannot be kept, it is done in this process, each time.
    """
    root = cache_root()
    if root is None or not KERNELS:
        _rehearse(scenario, seed, options)
        return True
    rehearsed = any(_is_ready(_cast(root, scenario.shape, task)) for task in range(options.until_task, TASKS + 1))
    if not rehearsed:
        with ProcessPoolExecutor(max_workers=1, mp_context=multiprocessing.get_context("spawn")) as pool:
            pool.submit(_rehearse, scenario, seed, options).result()
        _cast(root, scenario.shape, options.until_task).write_text(
            "\n".join(name for name, ready in _kernels().items() if ready)
        )
    warm_up()
    return not rehearsed


def _cast(root: Path, shape: str, until_task: int) -> Path:
    """Return the file that names the kernels which a rehearsal with a shape of object, up to a task, has called."""
    return root / f"rehearsed-{shape}-{until_task}"


def _is_ready(cast: Path) -> bool:
    """Return whether all kernels that a rehearsal has called, as they are now, can be made ready."""
    if not cast.exists():
        return False
    ready = _kernels()
    return all(ready.get(name, True) for name in cast.read_text().splitlines())


def _kernels() -> dict[str, bool]:
    """Return all kernels by their names, and whether it is known with what this version of them is called."""
    return {f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}": file.exists() for kernel, file in KERNELS}


def _rehearse(scenario: Scenario, seed: int, options: RunOptions) -> None:
    from preshape.tools.session import run_session

    asked = {name: getattr(options, name) for name in ("field", "ties", "norm", "until_task")}
    run_session(scenario, seed, RunOptions(**asked, record=False, pictures=False))
