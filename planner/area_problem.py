"""What areas are planned for: a procedure on a box cut into sections, as bits over patches and components."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import cast

from preshape.hal.world import Opening
from preshape.planner.component import EVERY, Component, numbered, on_end_caps, surviving
from preshape.planner.hand_cover import Covers, hand_covers
from preshape.planner.procedure import Block, Hand, Procedure, Task
from preshape.planner.region import WHOLE
from preshape.planner.sections import Sections

Usable = Callable[[Hand, Task, Component], bool]
"""Whether a hand can use a component in a task: face on the table, span, reach, visibility (section III-C)."""


@dataclass(frozen=True, slots=True, eq=False)
class AreaProblem:
    """A procedure, the box's sections, the opening if it is known, and the restrictions on components."""

    procedure: Procedure
    sections: Sections
    opening: Opening | None
    palm_on_end_caps_only: bool = False
    usable: Usable | None = None
    _asked: dict[tuple[Hand, Task], tuple[int, int]] = field(
        default_factory=dict[tuple[Hand, Task], tuple[int, int]], repr=False
    )
    """Components that `usable` was asked about and those it allowed: each is asked once, also by derived problems."""

    @property
    def covers(self) -> Covers:
        """What each component keeps from the other hand."""
        return hand_covers(self.sections)

    def wanted(self, block: Block) -> int:
        """Return the patches a block asks for: all for a grasp, the given area otherwise."""
        if block.want == "grasp":
            return WHOLE
        if block.want == "middle":
            return self.sections.middle().mask
        if block.want == "candidates":
            return self.sections.candidates().mask
        return self.sections.opening(self.opening).mask

    def kept_out(self, block: Block) -> int:
        """Return the patches that a given area keeps from a grasp in the committed reading.

        A hand that opens the box sweeps all of the opening's face, and the lid with it.
        """
        if block.want == "opening" and block.resource != "c":
            return self.sections.opened_faces(self.opening).mask
        return self.wanted(block)

    def allowed(self, hand: Hand, *tasks: Task, among: int = EVERY) -> int:
        """Return the components, `among` some, that a hand may use in all these tasks, whatever the areas.

        A component is asked about only while it is still in question: an answer may take an arm's inverse kinematics.
        """
        chosen = among & (on_end_caps() if self.palm_on_end_caps_only else EVERY)
        for task in tasks:
            chosen = self._usable_in(hand, task, chosen)
        return chosen

    def _usable_in(self, hand: Hand, task: Task, among: int) -> int:
        if self.usable is None:
            return among
        asked, able = self._asked.get((hand, task), (0, 0))
        new = among & ~asked
        if new:
            for bit, component in numbered(self.sections.long_axis, new):
                if self.usable(hand, task, component):
                    able |= bit
            self._asked[hand, task] = asked | new, able
        return able & among

    def allowed_in(self, block: Block, among: int = EVERY) -> int:
        """Return the components, `among` some, that a grasp block's hand may use in all its tasks."""
        tasks = self.procedure.tasks[block.first - 1 : block.last]
        return self.allowed(cast(Hand, block.resource), *tasks, among=among)

    def free_of_given(self, block: Block, given: tuple[Block, ...]) -> int:
        """Return the components that keep out of these given areas where they share a task with a grasp block."""
        taken = 0
        for other in given:
            if block.meets(other):
                taken |= self.kept_out(other)
        return surviving(WHOLE & ~taken)
