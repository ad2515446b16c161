"""A perception that tells listeners what it answers: the controller sees no difference."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from preshape.hal.answers import (
    QUESTIONS,
    AnyAnswer,
    FailedAnswer,
    ImageAnswer,
    ObstaclesAnswer,
    PoseAnswer,
    Question,
    same_obstacles,
    same_sample,
)
from preshape.hal.device import DeviceUnreachable
from preshape.hal.world import Image, OrientedBox, Perception, PoseSample

Listener = Callable[[AnyAnswer, NDArray[np.uint8] | None], None]
"""Is told of every answer that is new, and of an image's pixels (height, width); must not wait."""


class RecordedPerception:
    """`Perception` around another one, asked from one thread. Answers that are as before are not told."""

    def __init__(self, inner: Perception, *listeners: Listener) -> None:
        """Pass questions on to `inner`, and its answers to the listeners."""
        self._inner, self._listeners = inner, listeners
        self._calls: dict[Question, int] = dict.fromkeys(QUESTIONS, -1)
        self._sample: PoseSample | None = None
        self._obstacles: tuple[OrientedBox, ...] = ()

    def object_pose(self, now_ns: int) -> PoseSample | None:
        """Return the newest estimate that has arrived."""
        call = self._count("object_pose")
        sample = self._inner.object_pose(now_ns)
        if call == 0 or not same_sample(sample, self._sample):
            self._sample = sample
            self._tell(PoseAnswer(call=call, now_ns=now_ns, sample=sample), None)
        return sample

    def obstacles(self, now_ns: int) -> tuple[OrientedBox, ...]:
        """Return the obstacles seen up to now."""
        call = self._count("obstacles")
        obstacles = self._inner.obstacles(now_ns)
        if call == 0 or not same_obstacles(obstacles, self._obstacles):
            self._obstacles = obstacles
            self._tell(ObstaclesAnswer(call=call, now_ns=now_ns, obstacles=obstacles), None)
        return obstacles

    def image(self, now_ns: int) -> Image:
        """Take an image."""
        call = self._count("image")
        try:
            image = self._inner.image(now_ns)
        except DeviceUnreachable as error:
            self._tell(FailedAnswer(call=call, now_ns=now_ns, question="image", text=str(error)), None)
            raise
        answer = ImageAnswer(call=call, now_ns=now_ns, stamp_ns=image.stamp_ns, model=image.model)
        self._tell(answer, image.pixels)
        return image

    def _tell(self, answer: AnyAnswer, pixels: NDArray[np.uint8] | None) -> None:
        for listener in self._listeners:
            listener(answer, pixels)

    def _count(self, question: Question) -> int:
        self._calls[question] += 1
        return self._calls[question]
