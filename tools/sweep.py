"""Many runs in parallel: scenarios x seeds over any back end of joblib, each run standing for itself."""

from __future__ import annotations

import importlib
import os
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal, cast

import joblib as untyped_joblib
from joblib.externals.loky.process_executor import BrokenProcessPool as BrokenLoky

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.sweep_run import Run, RunCase, RunOutcome, alone, guarded

joblib: Any = untyped_joblib  # its types contradict its documentation

WATCH_S = 0.5
"""How often a process of a sweep looks whether the sweep is there, s."""
Backend = Literal["loky", "threading", "dask", "ray"]


def parse_seeds(text: str) -> tuple[int, ...]:
    """Return the seeds that a text names: `7`, `0:40` (40 not included), `0:40:4`, or several with commas between.

    Raises:
        ConfigurationError: something else, a negative seed, one named twice, or none at all.
    """
    seeds: list[int] = []
    for part in text.split(","):
        try:
            bounds = [int(number) for number in part.split(":")]
            seeds += bounds if len(bounds) == 1 else list(range(*bounds))
        except (ValueError, TypeError) as error:
            raise ConfigurationError(f"seeds: got {text!r}, allowed are forms like 7, 0:40, 0:40:4, 1,5,9") from error
    if not seeds or min(seeds) < 0 or len(set(seeds)) != len(seeds):
        raise ConfigurationError(f"seeds: got {text!r}, allowed are one or more different numbers >= 0")
    return tuple(seeds)


@contextmanager
def back_end(name: Backend, jobs: int) -> Generator[None]:
    """Make joblib use a back end with so many jobs (-1: all cores of the machine or cluster).

    `dask` and `ray` connect to the cluster that their own settings name, or start a local one.

    Raises:
        ConfigurationError: the back end's package is not installed.
    """
    if name == "threading" or name == "loky":
        own: dict[str, Any] = {} if name == "threading" else {"initializer": end_with, "initargs": (os.getpid(),)}
        with joblib.parallel_config(name, n_jobs=jobs, **own):
            yield
        return
    try:
        if name == "ray":
            importlib.import_module("ray.util.joblib").register_ray()
            client = None
        else:
            client = importlib.import_module("distributed").Client()
    except ImportError as error:
        raise ConfigurationError(f"backend: {name} needs the package {error.name or name}: {error}") from error
    try:
        with joblib.parallel_config(name, n_jobs=jobs):
            yield
    finally:
        if client is not None:
            client.close()


def end_with(parent: int) -> None:
    """Let this process end soon after its parent has: a killed sweep leaves no runs at work."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()


def _parallel(calls: Iterable[Any], whole: bool = False, **settings: Any) -> Iterator[RunOutcome]:
    """Return outcomes as they come; all at once from a back end that cannot do better."""
    how = "list" if whole else "generator_unordered"
    return iter(cast(Iterable[RunOutcome], joblib.Parallel(return_as=how, batch_size=1, **settings)(calls)))


def sweep(
    cases: Sequence[RunCase],
    run: Run,
    backend: Backend = "loky",
    jobs: int = -1,
    progress: Callable[[RunOutcome], None] = lambda outcome: None,
) -> list[RunOutcome]:
    """Run all cases and return their outcomes in the order of the cases; `progress` hears of each as it ends.

    An exception in a run is that run's failure. When a process dies, joblib gives up all that were not done:
    these are run again, each in a process of its own, and the one that dies again is named.
    """
    outcomes: dict[tuple[str, str, int], RunOutcome] = {}

    def take(results: Iterator[RunOutcome]) -> None:
        for outcome in results:
            outcomes[outcome.key] = outcome
            progress(outcome)

    guard = joblib.delayed(guarded)
    with back_end(backend, jobs):
        try:
            take(_parallel((guard(run, case) for case in cases), whole=backend == "ray"))
        except BrokenLoky:
            left = [case for case in cases if case.key not in outcomes]
            take(_parallel((joblib.delayed(alone)(run, case) for case in left), backend="threading", n_jobs=jobs))
    return [outcomes[case.key] for case in cases]
