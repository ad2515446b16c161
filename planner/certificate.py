"""Why there is no plan: the constraints that leave an area without a component."""

from __future__ import annotations

from dataclasses import dataclass

from preshape.planner.procedure import Block


@dataclass(frozen=True, slots=True)
class Certificate:
    """An irreducible set of constraints that cannot hold together: without any one of them there is an area.

    Attributes:
        block: whose area is emptied: no component is left in it, or a given area is not whole.
        constraints: the blocks whose areas empty it.
        palm_on_end_caps_only: whether that restriction belongs to the set.
        availability: whether the components that a hand cannot use (table, span, reach) belong to it.
        scope: what else was tried in vain.
    """

    block: Block
    constraints: tuple[Block, ...]
    palm_on_end_caps_only: bool = False
    availability: bool = False
    scope: str = "priorities as derived"

    def __str__(self) -> str:
        causes = [str(block) for block in self.constraints]
        if self.palm_on_end_caps_only:
            causes.append("palms on end caps only")
        if self.availability:
            causes.append("components that the hand cannot use")
        left = "no component is left" if self.block.want == "grasp" else "the given area is not whole"
        return f"{self.block}: {left}; emptied by: {'; '.join(causes) or 'nothing else'} ({self.scope})"
