"""A recording as it is read back: whole, or up to where its writer was killed."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Footer, McapRecord, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader
from numpy.typing import NDArray

from preshape.hal.answers import AnyAnswer, ImageAnswer, decode_answer
from preshape.hal.cdr import decode_image, decode_record
from preshape.hal.recording_topics import ANSWER_TOPIC, GAP, IMAGE_TOPIC, SETUP, TICK_TOPIC
from preshape.hal.tick_record import TICK, TickRecord


class RecordingError(Exception):
    """A file that is no recording; the message says in one line what is wrong with it."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """What a run's controller was given, and what it did.

    Attributes:
        setup: JSON of its knowledge and options.
        ticks: (n,) of dtype `TICK`, in order.
        answers: of its perception, in order.
        images: pixels (height, width) by the call that took them.
        complete: whether the file was finished; if not, its writer was killed.
        gap: the first tick before which ticks are missing, None if there is no gap; `lost` how many are.
        wall_offset_ns: what the loop's clock lacks to Unix time.
    """

    setup: bytes
    ticks: TickRecord
    answers: tuple[AnyAnswer, ...]
    images: dict[int, NDArray[np.uint8]]
    complete: bool
    gap: int | None = None
    lost: int = 0
    wall_offset_ns: int = 0

    def pixels(self, answer: AnyAnswer) -> NDArray[np.uint8] | None:
        """Return what belongs to an answer that is an image, None for any other."""
        return self.images.get(answer.call) if isinstance(answer, ImageAnswer) else None


def read_recording(path: Path) -> Recording:
    """Return all that is complete in a file.

    Raises:
        RecordingError: it cannot be read, is no recording, or holds something else than its schemas say.
    """
    setup: bytes | None = None
    ticks: list[TickRecord] = []
    answers: list[AnyAnswer] = []
    images: dict[int, NDArray[np.uint8]] = {}
    topics: dict[int, str] = {}
    complete, gap, lost, wall_offset_ns = False, None, 0, 0
    try:
        for record in _records(path):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Attachment) and record.name == SETUP:
                setup = record.data
            elif isinstance(record, Metadata) and record.name == GAP:
                gap = int(record.metadata["before"]) if gap is None else gap
                lost += int(record.metadata["lost"])
            elif isinstance(record, Message):
                topic = topics.get(record.channel_id)
                if topic == TICK_TOPIC:
                    ticks.append(decode_record(record.data, TICK))
                    wall_offset_ns = record.log_time - int(ticks[-1]["now_ns"])
                elif topic == ANSWER_TOPIC:
                    answers.append(decode_answer(record.data))
                elif topic == IMAGE_TOPIC:
                    images[record.sequence] = decode_image(record.data)
            complete = isinstance(record, Footer)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    except (McapError, msgspec.ValidationError, KeyError, ValueError, struct.error) as error:
        raise RecordingError(f"{path}: no recording of this version: {type(error).__name__}: {error}") from error
    if setup is None:
        raise RecordingError(f"{path}: no recording: it lacks the attachment {SETUP}")
    return Recording(setup, np.array(ticks, TICK), tuple(answers), images, complete, gap, lost, wall_offset_ns)


def _records(path: Path) -> Iterator[McapRecord]:
    """Yield all records up to the end, or to where the file has been cut off."""
    with path.open("rb") as stream:
        reader = iter(StreamReader(stream, validate_crcs=True, record_size_limit=1 << 30).records)
        started = False
        while True:
            try:
                record = next(reader)
            except StopIteration:
                return
            except (struct.error, EOFError, CRCValidationError, zstandard.ZstdError, RuntimeError, McapError):
                if not started:
                    raise
                return
            started = True
            yield record
