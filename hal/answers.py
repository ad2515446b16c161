"""What the controller was told when it asked its perception: each answer that was new, and to which call."""

from __future__ import annotations

from typing import Any, Literal, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from preshape.hal.world import CameraModel, OrientedBox, PoseSample

Question = Literal["object_pose", "obstacles", "image"]
QUESTIONS: tuple[Question, ...] = get_args(Question)


class Answer(msgspec.Struct, frozen=True, kw_only=True, tag_field="to", eq=False):
    """One answer; `call` counts the calls of the same question 0, 1, 2, ..., `now_ns` is the time passed in."""

    call: int
    now_ns: int


class PoseAnswer(Answer, frozen=True, tag="object_pose", eq=False):
    """The newest pose sample; holds for the calls after it until the next one that was new."""

    sample: PoseSample | None


class ObstaclesAnswer(Answer, frozen=True, tag="obstacles", eq=False):
    """The obstacles seen; holds until the next one that was new."""

    obstacles: tuple[OrientedBox, ...]


class ImageAnswer(Answer, frozen=True, tag="image", eq=False):
    """An image, without its pixels: they are kept beside it, compressed with the rest of the file."""

    stamp_ns: int
    model: CameraModel


class FailedAnswer(Answer, frozen=True, tag="failed", eq=False):
    """A question that was answered by an exception: the device behind it could not be reached."""

    question: Question
    text: str


AnyAnswer = PoseAnswer | ObstaclesAnswer | ImageAnswer | FailedAnswer


def plain(value: Any) -> Any:
    """Return an array as nested lists: msgspec's `enc_hook`. JSON keeps every bit of a finite double."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise NotImplementedError(f"{type(value).__name__} has no place in a recording")


def rebuilt(kind: Any, value: Any) -> Any:
    """Return nested lists as the array of an annotated type: msgspec's `dec_hook`; null becomes NaN."""
    dtype = get_args(get_args(kind)[1])[0]
    array = np.array(value, dtype)
    array.setflags(write=False)
    return array


_ENCODER = msgspec.json.Encoder(enc_hook=plain)
_DECODER = msgspec.json.Decoder(AnyAnswer, dec_hook=rebuilt)


def encode_answer(answer: AnyAnswer) -> bytes:
    """Return an answer as JSON."""
    return _ENCODER.encode(answer)


def decode_answer(data: bytes) -> AnyAnswer:
    """Return the answer in JSON data; `msgspec.ValidationError` names what is wrong with it."""
    return _DECODER.decode(data)


def same_sample(a: PoseSample | None, b: PoseSample | None) -> bool:
    """Tell whether two samples are the same, bit for bit."""
    if a is None or b is None or a is b:
        return a is b
    return a.stamp_ns == b.stamp_ns and same_bits(a.X_world_box, b.X_world_box)


def same_obstacles(a: tuple[OrientedBox, ...], b: tuple[OrientedBox, ...]) -> bool:
    """Tell whether the same obstacles are seen at the same places, bit for bit."""
    return len(a) == len(b) and all(
        x.name == y.name and same_bits(x.X_world_box, y.X_world_box) and same_bits(x.half, y.half)
        for x, y in zip(a, b, strict=True)
    )


def same_bits(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Tell whether two arrays hold the same bits."""
    return a is b or (a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes())
