"""A recording being written: an MCAP file whose complete part grows each second, whatever happens to the writer."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from preshape.hal.answers import AnyAnswer, ImageAnswer, encode_answer
from preshape.hal.cdr import encode_image, encode_record
from preshape.hal.recording_topics import (
    ANSWER_TOPIC,
    GAP,
    IMAGE_TOPIC,
    JOINT_LAYOUTS,
    PROFILE,
    SETUP,
    TICK_TOPIC,
    TOPICS,
    joint_topics,
)
from preshape.hal.tick_record import TickRecord

FLUSH_NS = 500_000_000
"""Time on the loop's clock after which what is written is completed in the file, ns."""
JOINT_INTERVAL_NS = 10_000_000
"""Time between two joint states, ns: enough to plot; the ticks hold every sample."""
CHUNK_BYTES = 4 << 20
"""Size at which a part is completed before its time, bytes."""


class RecordingFile:
    """Writes ticks, answers and joint states; call `flush` now and then, `close` at the end. One thread."""

    def __init__(self, path: Path, setup: bytes, wall_offset_ns: int = 0) -> None:
        """Create the file; `setup` is JSON, kept as it is.

        `wall_offset_ns` is added to the loop's times in all messages' log times, so that viewers show the date;
        what replays keeps the loop's own.
        """
        self._stream: BinaryIO = path.open("wb")
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile=PROFILE, library="preshape")
        self._writer.add_attachment(0, 0, SETUP, "application/json", setup)
        schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        for topic in TOPICS:
            if topic.schema not in schemas:
                schemas[topic.schema] = self._writer.register_schema(
                    topic.schema, topic.schema_encoding, topic.text.encode()
                )
            self._channels[topic.topic] = self._writer.register_channel(
                topic.topic, topic.encoding, schemas[topic.schema]
            )
        self._wall_offset_ns = wall_offset_ns
        self._count = 0
        self._joints_due_ns = self._flush_due_ns = -(2**62)
        self._parts = joint_topics()

    def add_answer(self, answer: AnyAnswer, pixels: NDArray[np.uint8] | None = None) -> None:
        """Write one answer of the perception, before the tick that used it."""
        self._add(ANSWER_TOPIC, answer.now_ns, encode_answer(answer), answer.call)
        if pixels is not None and isinstance(answer, ImageAnswer):
            self._add(IMAGE_TOPIC, answer.now_ns, encode_image(answer.stamp_ns, pixels), answer.call)

    def add_ticks(self, records: TickRecord) -> None:
        """Write records (n,) of dtype `TICK`, and joint states of some of them; completes the file when it is due."""
        for record in records:
            self._add(TICK_TOPIC, int(record["now_ns"]), encode_record(record), self._count)
            self._count += 1
        self._add_joints(records)
        if len(records) and int(records["now_ns"][-1]) >= self._flush_due_ns:
            self._flush_due_ns = int(records["now_ns"][-1]) + FLUSH_NS
            self.flush()

    def add_gap(self, before: int, lost: int) -> None:
        """Say that so many ticks are missing before the tick with this number: a replay ends there."""
        self._writer.flush()
        self._writer.add_metadata(GAP, {"before": str(before), "lost": str(lost)})

    def flush(self) -> None:
        """Complete what has been written: a reader gets it even if nothing follows."""
        self._writer.flush()

    def close(self) -> None:
        """Complete the file with its index."""
        if not self._stream.closed:
            self._writer.finish()
            self._stream.close()

    def _add(self, topic: str, now_ns: int, data: bytes, sequence: int) -> None:
        time_ns = max(0, now_ns + self._wall_offset_ns)
        self._writer.add_message(self._channels[topic], time_ns, data, time_ns, sequence)

    def _add_joints(self, records: TickRecord) -> None:
        due: list[int] = []
        for row, now_ns in enumerate(records["now_ns"].tolist()):
            if now_ns >= self._joints_due_ns:
                due.append(row)
                self._joints_due_ns = now_ns + JOINT_INTERVAL_NS
        if not due:
            return
        some = records[due]
        for topic, part in self._parts.items():
            values = (some[name][:, part] for name in ("position", "velocity", "torque"))
            messages = JOINT_LAYOUTS[topic].encode(some["now_ns"] + self._wall_offset_ns, *values)
            for now_ns, data in zip(some["now_ns"].tolist(), messages, strict=True):
                self._add(topic, now_ns, data, 0)
