"""A procedure as data: what is done task by task, which hand keeps which area, who leads, who holds the box."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from preshape.hal.layout import Side

Hand = Literal["r", "l"]
Resource = Literal["r", "l", "c"]
Main = Literal["r", "l", "c", "none"]
Want = Literal["grasp", "opening", "middle", "candidates"]
Place = Literal["here", "lifted", "shown", "passed on", "handed over", "opened"]
"""Where a task has the object: where it is now; straight above; in the air with every face that may carry the opening
to the camera in turn; in the air with any long face forward; in the air with the opening's face forward; at one of the
places that suit opening it."""

HANDS: tuple[Hand, Hand] = ("r", "l")
RESOURCES: tuple[Resource, Resource, Resource] = ("r", "l", "c")
SIDE_OF: dict[Hand, Side] = {"r": "right", "l": "left"}
HAND_OF: dict[Side, Hand] = {side: hand for hand, side in SIDE_OF.items()}

_WANTS: dict[Resource, tuple[Want, ...]] = {
    "r": ("grasp", "opening"),
    "l": ("grasp", "opening"),
    "c": ("middle", "candidates", "opening"),
}


@dataclass(frozen=True, slots=True)
class Task:
    """One task.

    Attributes:
        name: what it is called in tables and reports.
        tau: its priority; 1 = its motion is given, 2 = it is planned (section III-B).
        main: the resource that does the task's work; "none" where no hand or camera leads.
        holder: the hand that holds the box when the task ends, None while the box rests.
        regrasps: in an added regrasp, the hand that lets go and grasps anew.
        place: where the object is in it.
    """

    name: str
    tau: int = 2
    main: Main = "none"
    holder: Hand | None = None
    regrasps: Hand | None = None
    place: Place = "here"

    def __post_init__(self) -> None:
        if self.tau < 1:
            raise ValueError(f"task {self.name}: tau must be an integer >= 1, got {self.tau}")
        if self.main not in (*RESOURCES, "none"):
            raise ValueError(f"task {self.name}: main must be r, l, c or none, got {self.main}")
        if self.holder not in (*HANDS, None) or self.regrasps not in (*HANDS, None):
            raise ValueError(f"task {self.name}: holder and regrasps must be r, l or None")

    def __hash__(self) -> int:
        return hash(self.name)


@dataclass(frozen=True, slots=True)
class Block:
    """A run of tasks over which one resource keeps one area: one chain of equalities of eq. (1).

    `first` and `last` are task numbers, counted from 1, both included. `want` says where the area comes from:
    "grasp" is planned; the others are given: the patch of the "opening", the whole "middle" section (Fig. 5), or
    only the "candidates" among its faces.
    """

    resource: Resource
    first: int
    last: int
    want: Want = "grasp"

    def __post_init__(self) -> None:
        if self.resource not in RESOURCES:
            raise ValueError(f"block: resource must be r, l or c, got {self.resource}")
        if not 1 <= self.first <= self.last:
            raise ValueError(f"block of {self.resource}: tasks {self.first} .. {self.last} are no run counted from 1")
        if self.want not in _WANTS[self.resource]:
            allowed = ", ".join(_WANTS[self.resource])
            raise ValueError(f"{self}: want must be one of {allowed}, got {self.want}")

    def __str__(self) -> str:
        names = {"r": "right hand", "l": "left hand", "c": "camera"}
        run = f"task {self.first}" if self.first == self.last else f"tasks {self.first}-{self.last}"
        return f"{names[self.resource]}, {run}"

    def covers(self, *numbers: int) -> bool:
        """Return whether all these tasks lie in the block."""
        return self.first <= min(numbers) and max(numbers) <= self.last

    def meets(self, other: Block) -> bool:
        """Return whether another resource's block shares a task with this one: only then do areas compete."""
        return self.resource != other.resource and self.first <= other.last and other.first <= self.last


@dataclass(frozen=True, slots=True)
class Procedure:
    """Tasks in order, and the blocks of all resources; a resource without a block in a task is not used there.

    Raises:
        ValueError: on construction, when a block lies outside the tasks, overlaps another of its resource, a main
            resource has no area, or the box is held by nobody where a task says that a hand holds it.
    """

    tasks: tuple[Task, ...]
    blocks: tuple[Block, ...]

    def __post_init__(self) -> None:
        if not self.tasks:
            raise ValueError("procedure: tasks is empty, at least one is needed")
        for block in self.blocks:
            if block.last > len(self.tasks):
                raise ValueError(f"{block}: the procedure has only {len(self.tasks)} tasks")
        self._check_overlaps()
        for number, task in self.numbered():
            self._check_task(number, task)

    def _check_overlaps(self) -> None:
        for resource in RESOURCES:
            own = sorted((b for b in self.blocks if b.resource == resource), key=lambda b: (b.first, b.last))
            for earlier, later in zip(own, own[1:], strict=False):
                shared = earlier.last == later.first and self.tasks[earlier.last - 1].regrasps == resource
                if earlier.last >= later.first and not shared:
                    raise ValueError(f"{earlier} and {later}: two areas of one resource overlap in task {later.first}")

    def _check_task(self, number: int, task: Task) -> None:
        where = f"task {number} ({task.name})"
        if task.main != "none" and self.at(task.main, number) is None:
            raise ValueError(f"{where}: main resource {task.main} has no area there")
        if task.holder is not None and not self._grasps(task.holder, number, number):
            raise ValueError(f"{where}: holder {task.holder} has no grasp there")
        before = None if number == 1 else self.tasks[number - 2].holder
        if before is not None and not self._grasps(before, number - 1, number):
            raise ValueError(f"{where}: {before} held the box before but does not keep its grasp into this task")

    def _grasps(self, hand: Hand, first: int, last: int) -> bool:
        for b in self.blocks:
            if b.resource == hand and b.want == "grasp" and b.first <= first and last <= b.last:
                return True
        return False

    def numbered(self) -> Iterator[tuple[int, Task]]:
        """Yield every task with its number, from 1."""
        return enumerate(self.tasks, start=1)

    def at(self, resource: Resource, number: int) -> Block | None:
        """Return the block of a resource in a task (in an added regrasp: the new one), None if it is not used."""
        found = [b for b in self.blocks if b.resource == resource and b.covers(number)]
        return max(found, key=lambda b: b.first, default=None)

    @property
    def looked_in(self) -> int:
        """Number of the last task that the camera leads: the opening is known after it; 0 if there is none."""
        return max((number for number, task in self.numbered() if task.main == "c"), default=0)

    def meeting(self, block: Block) -> tuple[Block, ...]:
        """Return the blocks of other resources that share a task with a block."""
        return tuple(other for other in self.blocks if block.meets(other))


PAPER_PROCEDURE = Procedure(
    tasks=(
        Task("grasp", 1, "none", "r"),
        Task("find", 1, "c", "r", place="shown"),
        Task("regrasp", 2, "none", "l", place="handed over"),
        Task("crush", 1, "r", "l", place="opened"),
        Task("open", 1, "r", "l", place="opened"),
    ),
    blocks=(
        Block("r", 1, 3),
        Block("c", 2, 2, "middle"),
        Block("l", 3, 5),
        Block("r", 4, 4, "opening"),
        Block("r", 5, 5, "opening"),
    ),
)
"""The five tasks of section II with the equalities of eq. (1)."""

LIFT_PROCEDURE = Procedure(
    tasks=(Task("grasp", 1, "none", "r"), Task("hold", 1, "none", "r", place="lifted")),
    blocks=(Block("r", 1, 2),),
)
"""What is done with an object that has no opening: take it, lift it, hold it."""
