"""How long named stages of a tick take: methods watched for a while, their time summed up per tick."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

Watched = tuple[type[Any], str]
"""A class and the name of one of its methods."""


class StageTimes:
    """Time per stage and tick, ns; a stage inside another counts for itself only, not for the outer one."""

    def __init__(self, stages: tuple[str, ...], clock: Callable[[], int] = time.perf_counter_ns) -> None:
        """Name the stages; `clock` is in ns."""
        self.stages = stages
        self._clock = clock
        self._ticks: list[NDArray[np.int64]] = []
        self._now: NDArray[np.int64] = np.zeros(len(stages), dtype=np.int64)
        self._inner_ns = 0

    def run(self, stage: int, call: Callable[[], Any]) -> Any:
        """Call, and book what it took without the stages inside on a stage of this tick."""
        before, self._inner_ns = self._inner_ns, 0
        start = self._clock()
        try:
            return call()
        finally:
            spent = self._clock() - start
            self._now[stage] += spent - self._inner_ns
            self._inner_ns = before + spent

    def end_tick(self, keep: bool) -> None:
        """Close a tick; those not kept are forgotten."""
        if keep:
            self._ticks.append(self._now.copy())
        self._now[:] = 0

    def table_us(self) -> NDArray[np.float64]:
        """Return microseconds of every kept tick and stage, (ticks, stages)."""
        return np.array(self._ticks, dtype=np.float64).reshape(-1, len(self.stages)) * 1e-3


@contextmanager
def watching(times: StageTimes, methods: Mapping[Watched, str]) -> Generator[None]:
    """Book every call of the methods on their stages until the end of the block; the classes are as before then."""
    before = {(owner, name): owner.__dict__[name] for owner, name in methods}
    try:
        for (owner, name), stage in methods.items():
            setattr(owner, name, _watched(times, times.stages.index(stage), before[owner, name]))
        yield
    finally:
        for (owner, name), method in before.items():
            setattr(owner, name, method)


def _watched(times: StageTimes, stage: int, method: Callable[..., Any]) -> Callable[..., Any]:
    def call(*args: Any, **kwargs: Any) -> Any:
        return times.run(stage, lambda: method(*args, **kwargs))

    return call
