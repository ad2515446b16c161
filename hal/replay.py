"""A recording as the world of a loop: the device, the clock and the perception of a run that has been."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from preshape.hal.answers import AnyAnswer, FailedAnswer, ImageAnswer, ObstaclesAnswer, PoseAnswer, Question
from preshape.hal.device import DeviceUnreachable
from preshape.hal.recording import Recording
from preshape.hal.state import DeviceStatus, RobotCommand, RobotState
from preshape.hal.tick_record import TickRecord, text_of
from preshape.hal.world import Image, OrientedBox, PoseSample


class ReplayEnded(Exception):
    """The recording has no answer to what is asked now; the message says what was asked."""


def recorded_state(record: TickRecord) -> RobotState:
    """Return the state that the device reported in a tick."""
    return RobotState(
        int(record["state_sequence"]),
        record["position"],
        record["velocity"],
        record["torque"],
        record["stamp_ns"],
        DeviceStatus(int(record["status"])),
        text_of(record, "fault"),
    )


class ReplayDevice:
    """`preshape.hal.device.Device` that answers as a device once did; what is written moves nothing.

    States are given out one a `read`, refusals one a `write` and one an `arm`, in the order in which they were met.
    """

    def __init__(self, states: Iterable[RobotState], taken: Iterable[bool], refusals: Iterable[str] = ()) -> None:
        """Replay states, whether each write was taken, and why each arming was refused (empty: it was not)."""
        self._states, self._taken, self._refusals = iter(states), iter(taken), iter(refusals)
        self.written: deque[RobotCommand] = deque(maxlen=1)

    def open(self) -> None:
        """Nothing is connected."""

    def read(self, now_ns: int) -> RobotState:
        """Return the next state; `ReplayEnded` after the last one."""
        state = next(self._states, None)
        if state is None:
            raise ReplayEnded("no further state is recorded")
        return state

    def arm(self, now_ns: int) -> None:
        """Accept, or refuse with the recorded cause."""
        cause = next(self._refusals, "")
        if cause:
            raise RuntimeError(cause)

    def write(self, command: RobotCommand, now_ns: int) -> bool:
        """Keep the command as the last one and return whether one at this place was taken."""
        self.written.append(command)
        return next(self._taken, False)

    def stop(self, reason: str, now_ns: int) -> None:
        """Nothing moves."""

    def close(self) -> None:
        """Nothing is connected."""


class ReplayClock:
    """`preshape.hal.clock.Clock` that reads what the loop's clock read: once at the start, then once a tick.

    Before each tick `ended` is asked; when it says so, waiting raises `ReplayEnded`.
    """

    def __init__(self, ticks: TickRecord, ended: Callable[[], bool] = lambda: False) -> None:
        """Take the times of recorded ticks (n,), n >= 1."""
        self._times: list[int] = ticks["now_ns"].tolist()
        # The first tick is due when the loop starts: it was as late as the clock had gone on since.
        self._now_ns = self._times[0] - int(ticks["lateness_ns"][0])
        self._ended, self._next = ended, 0

    def now_ns(self) -> int:
        """Return the time of the tick under way."""
        return self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Go on to the next recorded tick; `ReplayEnded` after the last one."""
        if self._ended() or self._next == len(self._times):
            raise ReplayEnded("no further tick is recorded")
        self._now_ns = self._times[self._next]
        self._next += 1


class ReplayPerception:
    """`preshape.hal.world.Perception` that answers each call as it was answered.

    A call at another time than the recorded one, or one that was never answered, raises `ReplayEnded`: whoever asks
    has gone another way than before.
    """

    def __init__(self, recording: Recording) -> None:
        """Answer from a recording."""
        self._left: dict[Question, deque[AnyAnswer]] = {"object_pose": deque(), "obstacles": deque(), "image": deque()}
        for answer in recording.answers:
            self._left[_question(answer)].append(answer)
        self._calls: dict[Question, int] = dict.fromkeys(self._left, -1)
        self._images = recording.images
        self._sample: PoseSample | None = None
        self._obstacles: tuple[OrientedBox, ...] = ()

    def object_pose(self, now_ns: int) -> PoseSample | None:
        """Return the sample that was the newest at this call."""
        answer = self._answer("object_pose", now_ns)
        if isinstance(answer, PoseAnswer):
            self._sample = answer.sample
        return self._sample

    def obstacles(self, now_ns: int) -> tuple[OrientedBox, ...]:
        """Return the obstacles that were seen at this call."""
        answer = self._answer("obstacles", now_ns)
        if isinstance(answer, ObstaclesAnswer):
            self._obstacles = answer.obstacles
        return self._obstacles

    def image(self, now_ns: int) -> Image:
        """Return the image taken at this call, or fail as it failed."""
        answer = self._answer("image", now_ns)
        if isinstance(answer, FailedAnswer):
            raise DeviceUnreachable(answer.text)
        if not isinstance(answer, ImageAnswer) or answer.call not in self._images:
            raise ReplayEnded(f"image {self._calls['image']} is not recorded")
        return Image(answer.stamp_ns, self._images[answer.call], answer.model)

    def _answer(self, question: Question, now_ns: int) -> AnyAnswer | None:
        """Return the answer given at this call, None if it was the one before once more."""
        self._calls[question] += 1
        call, left = self._calls[question], self._left[question]
        if not left or left[0].call > call:
            if call == 0:
                raise ReplayEnded(f"{question} was never asked for")
            return None
        if left[0].now_ns != now_ns:
            raise ReplayEnded(f"{question} was asked for at {left[0].now_ns} ns, not at {now_ns} ns")
        return left.popleft()


def _question(answer: AnyAnswer) -> Question:
    match answer:
        case PoseAnswer():
            return "object_pose"
        case ObstaclesAnswer():
            return "obstacles"
        case ImageAnswer():
            return "image"
        case FailedAnswer():
            return answer.question
