"""Where the box is, at any moment: the filtered estimate, carried along by the hand that holds it."""

from __future__ import annotations

from preshape.control.body import Body
from preshape.control.object_filter import BoxEstimate, ObjectFilter
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix
from preshape.hal.world import Image, OrientedBox, Perception


class Sight:
    """Perception filtered and tied to the holding hand; `update` once a tick."""

    def __init__(self, perception: Perception, body: Body) -> None:
        """Start with the box standing still somewhere."""
        self._perception, self._body = perception, body
        self._filter = ObjectFilter()
        self.held_by: Side | None = None
        self.estimate: BoxEstimate | None = None
        self.obstacles: tuple[OrientedBox, ...] = ()

    def update(self, now_ns: int) -> None:
        """Take this tick's palm pose and any new sample."""
        if self.held_by is not None:
            self._filter.palm(now_ns, self._body.palm(self.held_by))
        sample = self._perception.object_pose(now_ns)
        if sample is not None:
            self._filter.observe(sample)
        self.estimate = self._filter.estimate(now_ns)
        self.obstacles = self._perception.obstacles(now_ns)

    @property
    def settled(self) -> bool:
        """Whether the estimate is fresh and agrees with its samples."""
        return self.estimate is not None and self.estimate.settled

    @property
    def jumps(self) -> int:
        """How often the estimate was replaced at once: who aimed at an older one should aim again."""
        return 0 if self.estimate is None else self.estimate.jumps

    @property
    def X_world_box(self) -> Matrix:
        """The estimated pose now; `RuntimeError` before the first sample."""
        if self.estimate is None:
            raise RuntimeError("no sample of the box has arrived yet")
        return self.estimate.X_world_box

    def hold(self, side: Side) -> None:
        """From now on the box moves with this hand."""
        self._filter.hold(self._body.now_ns, self._body.palm(side))
        self.held_by = side

    def release(self) -> None:
        """From now on the box stands still."""
        self._filter.release(self._body.now_ns)
        self.held_by = None

    def correct(self, seen_ns: int, X_world_box: Matrix) -> bool:
        """Take a pose measured in an image as the better one."""
        return self._filter.correct(seen_ns, X_world_box)

    def image(self) -> Image:
        """Take an image now."""
        return self._perception.image(self._body.now_ns)
