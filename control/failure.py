"""How a task ends when it does not end well: always with a name."""

from __future__ import annotations


class TaskFailed(Exception):
    """A task has ended without success; `cause` is one of the named ways out.

    The first word of `cause` is its class: timed out, slipped, dropped, missed, stalled, moved,
    unreachable, unseen, no span.
    """

    def __init__(self, cause: str) -> None:
        super().__init__(cause)
        self.cause = cause

    @property
    def kind(self) -> str:
        """The class of the cause."""
        return self.cause.partition(":")[0]
