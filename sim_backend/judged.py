"""What the referee asks of an object: the tasks, who may touch whom in each, and what their ends are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from preshape.hal.object_shape import ShapeName
from preshape.sim_backend.contact_rules import LIFT_RULES, RULES, Rules
from preshape.sim_backend.lift_stages import LiftStages
from preshape.sim_backend.referee_report import LIFT_TASK_NAMES, TASK_NAMES
from preshape.sim_backend.stages import Stages


@dataclass(frozen=True, slots=True)
class Judged:
    """One procedure as it is judged.

    Attributes:
        names: task number -> name.
        rules: stage -> pairs that may touch.
        stages: makes what walks through the tasks on true events.
        desired: task -> the event that shows the contact it asks for.
        passed_on: whether the left hand takes the object over.
        achieved: what a success is, in words.
    """

    names: Mapping[int, str]
    rules: Rules
    stages: Callable[[], Stages]
    desired: Mapping[str, str]
    passed_on: bool
    achieved: str


OPENING = Judged(
    TASK_NAMES,
    RULES,
    Stages,
    {"1": "lift_off", "3": "T3", "4": "tab_touch", "5": "pinched"},
    passed_on=True,
    achieved="the box is open",
)
LIFTING = Judged(
    LIFT_TASK_NAMES, LIFT_RULES, LiftStages, {"1": "lift_off"}, passed_on=False, achieved="the object is held"
)


def judged(shape: ShapeName) -> Judged:
    """Return what is asked of an object of a shape: a paper box is opened, anything else is lifted and held."""
    return OPENING if shape == "box" else LIFTING
