"""The 14 moments of the paper's Fig. 6: snapshots kept cheaply during a run, and which of them are shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

INNER_FRAMES: Mapping[int, int] = {1: 0, 2: 2, 3: 5, 4: 0, 5: 1}
"""Frames strictly inside each task; one more shows its end, and the first of all the start of task 1.

Fig. 6: (1)-(2) task 1, (2)-(5) task 2, (5)-(11) task 3, (11)-(12) task 4, (12)-(14) task 5."""

LIFT_INNER_FRAMES: Mapping[int, int] = {1: 6, 2: 1}
"""The same for an object that is lifted: all that happens before it is held."""

FRAMES = 1 + sum(inner + 1 for inner in INNER_FRAMES.values())
"""Frames of a run with all five tasks of the opening."""


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The positions of everything at one moment, and what was being done; `closes` marks a phase's last moment."""

    time_s: float
    task: int
    phase: str
    qpos: NDArray[np.float64]
    closes: bool = False


class StoryboardRecorder:
    """Fed every tick; keeps each task's first and each phase's last moment, and one snapshot each `interval_s`.

    A tick that keeps nothing costs one copy into a buffer.
    """

    def __init__(self, interval_s: float = 0.25) -> None:
        """Keep at least one snapshot each `interval_s` (s)."""
        if interval_s <= 0:
            raise ValueError(f"interval_s must be > 0, got {interval_s}")
        self.interval_s = interval_s
        self._kept: list[Snapshot] = []
        self._newest: NDArray[np.float64] | None = None
        self._time_s, self._task, self._phase = 0.0, 0, ""

    def feed(self, time_s: float, task: int, phase: str, qpos: NDArray[np.float64]) -> None:
        """Take note of one moment; `qpos` is copied."""
        if self._newest is None:
            self._newest = np.array(qpos, dtype=np.float64)
            self._time_s, self._task, self._phase = time_s, task, phase
            self._keep(closes=False)
            return
        new_task = task != self._task
        if new_task or phase != self._phase:
            self._keep(closes=True)
        self._newest[:] = qpos
        self._time_s, self._task, self._phase = time_s, task, phase
        if new_task or time_s - self._kept[-1].time_s >= self.interval_s:
            self._keep(closes=False)

    def snapshots(self) -> list[Snapshot]:
        """Return what was kept, in the order of time, the newest moment last."""
        if self._newest is None:
            return []
        return [*self._kept, self._snapshot(closes=True)]

    def _snapshot(self, closes: bool) -> Snapshot:
        assert self._newest is not None
        frozen = self._newest.copy()
        frozen.setflags(write=False)
        return Snapshot(self._time_s, self._task, self._phase, frozen, closes)

    def _keep(self, closes: bool) -> None:
        self._kept.append(self._snapshot(closes))


def last_attempts(snapshots: Sequence[Snapshot]) -> dict[int, list[Snapshot]]:
    """Return each task's snapshots of its last uninterrupted stretch: what a retry overtook is left out."""
    attempts: dict[int, list[Snapshot]] = {}
    previous: int | None = None
    for snapshot in snapshots:
        if snapshot.task != previous:
            attempts[snapshot.task] = []
        attempts[snapshot.task].append(snapshot)
        previous = snapshot.task
    return attempts


def spread(candidates: Sequence[Snapshot], count: int, anchors: Sequence[Snapshot]) -> list[Snapshot]:
    """Return up to `count` of the candidates in the order of time.

    First the ends of phases, evenly chosen when there are too many; then whatever lies farthest in time
    from all that is shown already, `anchors` included.
    """
    closing = [snapshot for snapshot in candidates if snapshot.closes]
    if len(closing) >= count:
        return [closing[(2 * i + 1) * len(closing) // (2 * count)] for i in range(count)]
    chosen, rest = closing, [snapshot for snapshot in candidates if not snapshot.closes]
    while rest and len(chosen) < count:
        shown = np.array([snapshot.time_s for snapshot in (*anchors, *chosen)])
        gaps = [np.min(np.abs(shown - snapshot.time_s)) for snapshot in rest]
        chosen.append(rest.pop(int(np.argmax(gaps))))
    return sorted(chosen, key=lambda snapshot: snapshot.time_s)


def pick_frames(
    snapshots: Sequence[Snapshot],
    closing_phase: Mapping[int, str] | None = None,
    inner_frames: Mapping[int, int] = INNER_FRAMES,
) -> list[Snapshot]:
    """Return the frames of the storyboard in the order of time: 14 of a run with all five tasks, else fewer.

    `closing_phase` names, for a task, the phase whose end stands for the task's end (task 4 ends with the
    hand off the box again; its picture is the push).
    """
    attempts = last_attempts(snapshots)
    frames: list[Snapshot] = []
    for task, inner in inner_frames.items():
        stretch = attempts.get(task)
        if not stretch:
            continue
        if not frames:
            frames.append(stretch[0])
        wanted = (closing_phase or {}).get(task)
        ends = [s for s in stretch if s.closes and s.phase == wanted]
        end = ends[-1] if ends else stretch[-1]
        between = [s for s in stretch[1:] if s.time_s < end.time_s]
        frames += [*spread(between, inner, (stretch[0], end)), end]
    most = 1 + sum(inner + 1 for inner in inner_frames.values())
    if frames and snapshots[-1].time_s > frames[-1].time_s and len(frames) < most:
        frames.append(snapshots[-1])
    return sorted(frames, key=lambda snapshot: snapshot.time_s)
