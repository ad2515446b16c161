"""Why a run is no success: one task, one cause, from what the loop, the controller and the referee say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from preshape.control.loop_result import LoopOutcome, LoopResult
from preshape.sim_backend.referee_report import Verdict

LOOP_CAUSES = {
    LoopOutcome.TIME_UP: "timed out",
    LoopOutcome.STOPPED: "stopped",
    LoopOutcome.SAFETY_STOP: "safety stop",
}
"""How a loop's end is called when it is not the controller's."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A named failure: the task in which it happened and its cause, whose words before the first colon are its class.

    `also` lists what else the referee holds against the run, except what a failed task leaves undone anyway.
    """

    task: int
    name: str
    cause: str
    also: tuple[str, ...] = ()

    def __str__(self) -> str:
        text = f"task {self.task} ({self.name}): {self.cause}"
        return f"{text}; also {', '.join(self.also)}" if self.also else text


def name_failure(
    verdict: Verdict, ended: LoopResult | None, task: int, controller_failure: str | None, error: str | None
) -> Failure | None:
    """Return why a run failed, None for a success.

    `error`, of a run that was given up or not begun, counts before the loop's end, that before the controller's
    own word, and that before the referee's. `task` is what the controller was doing at last.
    """
    if verdict.success:
        return None
    name = _name(verdict, task)
    if error is not None:
        return Failure(task, name, error)
    if ended is not None and ended.outcome in LOOP_CAUSES:
        return Failure(task, name, f"{LOOP_CAUSES[ended.outcome]}: {ended.reason}", _beyond_undone(verdict))
    if controller_failure is not None:
        cause = controller_failure.partition("): ")[2] or controller_failure
        return Failure(task, name, cause, _beyond_undone(verdict))
    first = _first_seen(verdict)
    others = (name for name in _beyond_undone(verdict) if name.split(":")[0] != first[1].split(":")[0])
    return Failure(first[0], _name(verdict, first[0]), first[1], tuple(others))


def lost_failure(lost: str, ended: LoopResult | None, task: int, name: str, phase: str, error: str | None) -> Failure:
    """Return why a run failed whose world, and the referee in it, was lost: how, and how the loop ended upon it."""
    how = error if ended is None else f"{LOOP_CAUSES.get(ended.outcome, ended.outcome.value)}: {ended.reason}"
    return Failure(task, name, f"world lost: {lost}; in {phase}, {how}")


def _name(verdict: Verdict, task: int) -> str:
    return next(known.name for known in verdict.tasks if known.task == task)


def wire_failure(failure: Failure | None, broken: Mapping[str, int], task: int, name: str) -> Failure | None:
    """Return why a run failed when rules of the wire were broken as well, each so often, at last in this task."""
    if not broken:
        return failure
    cause = f"wire rule broken: {', '.join(f'{rule} {count} times' for rule, count in broken.items())}"
    return Failure(task, name, cause) if failure is None else replace(failure, also=(*failure.also, cause))


def _beyond_undone(verdict: Verdict) -> tuple[str, ...]:
    """Return the referee's objections that do not follow from a task not being done."""
    all_done = not verdict.undone
    return tuple(name for name in verdict.failures if all_done or not name.startswith(("task ", "torn fraction ")))


def _first_seen(verdict: Verdict) -> tuple[int, str]:
    """Return the earliest thing that the referee holds against a run, and the task in which it happened."""
    seen: list[tuple[float, str]] = [
        (time_s, f"undesired contact: {link} on {geom} at {time_s:.2f} s")
        for link, geom, time_s in verdict.undesired_contacts[:1]
    ]
    seen += [(verdict.events[name], f"{name}: at {verdict.events[name]:.2f} s") for name in _named(verdict)]
    if seen:
        time_s, cause = min(seen)
        return _task_at(verdict, time_s), cause
    if verdict.undone:
        return verdict.undone[0].task, "not done: the referee does not see its end"
    return verdict.until_task, verdict.failures[0]


def _named(verdict: Verdict) -> list[str]:
    return [name for name, bad in (("dropped", verdict.dropped), ("crushed", verdict.crushed)) if bad]


def _task_at(verdict: Verdict, time_s: float) -> int:
    done = [task.task for task in verdict.tasks if task.end_s is not None and task.end_s <= time_s]
    return min(max(done, default=0) + 1, len(verdict.tasks))
