"""What a robot publishes as an MCAP file: every message as it came, and joint states for viewers that draw plots."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer

from preshape.hal.cdr import JOINT_STATE_SCHEMA, JointStateLayout
from preshape.hal.recording_topics import PROFILE
from preshape.tools.telemetry_info import schema_info
from preshape.tools.telemetry_keys import Keys
from preshape.tools.telemetry_messages import AnyMessage, JointsState, Stamped, encode_message, schema_of

CHUNK_BYTES = 1 << 20


class TelemetryFile:
    """Writes messages; `flush` twice a second, `close` at the end.

    Topics are the keys, with JSON under the published schemas, and `/<side>/<limb>/joint_states` in CDR.
    """

    def __init__(self, path: Path, keys: Keys) -> None:
        """Create the file."""
        self._stream: BinaryIO = path.open("wb")
        self._writer = Writer(self._stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile=PROFILE, library="preshape")
        self._keys = keys
        self._definitions = schema_info().definitions
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._layouts: dict[str, JointStateLayout] = {}
        self.count = 0

    def add(self, tail: str, message: AnyMessage, now_ns: int) -> None:
        """Write one message that has come at a time (Unix, ns)."""
        stamp_ns = message.stamp_ns if isinstance(message, Stamped) else now_ns
        seq = message.seq if isinstance(message, Stamped) else 0
        channel = self._channels.get(tail)
        if channel is None:
            schema = self._json_schema(schema_of(type(message)))
            channel = self._channels[tail] = self._writer.register_channel(f"/{self._keys.of(tail)}", "json", schema)
        self._writer.add_message(channel, now_ns, encode_message(message), stamp_ns, seq)
        if isinstance(message, JointsState):
            self._add_joints(tail, message, now_ns)
        self.count += 1

    def flush(self) -> None:
        """Complete what has been written: a reader gets it even if nothing follows."""
        self._writer.flush()

    def close(self) -> None:
        """Complete the file with its index."""
        self._writer.finish()
        self._stream.close()

    def _add_joints(self, tail: str, message: JointsState, now_ns: int) -> None:
        topic = f"{tail.removeprefix('state')}/joint_states"
        if topic not in self._layouts:
            if "joints" not in self._schemas:
                name, text = "sensor_msgs/msg/JointState", JOINT_STATE_SCHEMA.encode()
                self._schemas["joints"] = self._writer.register_schema(name, "ros2msg", text)
            self._layouts[topic] = JointStateLayout(message.name)
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas["joints"])
        values = [np.array([row], float) for row in (message.position, message.velocity, message.effort)]
        (data,) = self._layouts[topic].encode(np.array([message.stamp_ns]), *values)
        self._writer.add_message(self._channels[topic], now_ns, data, message.stamp_ns, message.seq)

    def _json_schema(self, schema: str) -> int:
        if schema not in self._schemas:
            # Viewers ask for an object at the top; the rest is referred to from there.
            text = {"type": "object", **self._definitions[schema], "definitions": self._definitions}
            self._schemas[schema] = self._writer.register_schema(schema, "jsonschema", msgspec.json.encode(text))
        return self._schemas[schema]
