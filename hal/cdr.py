"""Messages of ROS 2 in CDR, little-endian, written with plain numpy: fixed layouts, joint states, images.

A record whose numpy layout is that of C (`align=True`) is its own CDR body: fields and fixed arrays stand at
multiples of their element's size in both. The schema is then written from the dtype.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

HEADER = b"\x00\x01\x00\x00"
"""Encapsulation header: plain CDR, little-endian; positions in the body count from its end."""

_ROS_NAMES = {"f8": "float64", "i8": "int64", "i4": "int32", "i2": "int16", "i1": "int8", "u1": "uint8", "b1": "bool"}

TIME_SCHEMA = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

JOINT_STATE_SCHEMA = (
    """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort"""
    + TIME_SCHEMA
)

IMAGE_SCHEMA = (
    """std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data"""
    + TIME_SCHEMA
)


def record_schema(dtype: np.dtype[Any]) -> str:
    """Return the ros2msg definition of a C-aligned record; texts (`S`) become zero-padded arrays of bytes.

    Raises:
        ValueError: the record's layout is not that of CDR: packed, padded at its end, or of a type without a name.
    """
    fields: Any = dtype.fields or {}
    end, lines = 0, list[str]()
    for name in dtype.names or ():
        field, offset = fields[name][:2]
        base, count = field.base, int(np.prod(field.shape, dtype=int))
        kind, step = (("uint8", 1)) if base.kind == "S" else (_ROS_NAMES.get(base.str[1:], ""), base.itemsize)
        if not kind or offset != -(-end // step) * step:
            raise ValueError(f"{name}: got {field} at byte {offset}, allowed are C-aligned plain numbers and texts")
        count *= base.itemsize if base.kind == "S" else 1
        array = "" if field.shape == () and base.kind != "S" else f"[{count}]"
        lines.append(f"{kind}{array} {name.lower()}")
        end = offset + field.itemsize
    if end != dtype.itemsize:
        raise ValueError(f"record: got {dtype.itemsize - end} bytes of padding at its end, allowed is none")
    return "\n".join(lines)


def encode_record(record: NDArray[np.void]) -> bytes:
    """Return one record whose dtype `record_schema` accepts as a CDR message."""
    return HEADER + record.tobytes()


def decode_record(data: bytes, dtype: np.dtype[Any]) -> NDArray[np.void]:
    """Return the record in a message, without dimensions; `ValueError` when it has another length."""
    if len(data) != len(HEADER) + dtype.itemsize:
        raise ValueError(f"message: got {len(data)} bytes, allowed is {len(HEADER) + dtype.itemsize}")
    return np.frombuffer(data, dtype, 1, len(HEADER)).reshape(())


def _pad(size: int, to: int) -> bytes:
    return b"\x00" * (-size % to)


def _text(body: bytes, text: str) -> bytes:
    """Return the body with a text behind it: length with its final zero, then the bytes."""
    data = text.encode() + b"\x00"
    return body + _pad(len(body), 4) + struct.pack("<I", len(data)) + data


def _stamp(stamp_ns: int) -> bytes:
    return struct.pack("<iI", *divmod(stamp_ns, 10**9))


class JointStateLayout:
    """sensor_msgs/JointState of some joints: one template, of which only time and numbers change."""

    def __init__(self, names: Sequence[str], frame_id: str = "world") -> None:
        """Lay the message out for joints of these names."""
        body = _text(_stamp(0), frame_id)
        body += _pad(len(body), 4) + struct.pack("<I", len(names))
        for name in names:
            body = _text(body, name)
        offsets: list[int] = []
        for _ in range(3):
            body += _pad(len(body), 4) + struct.pack("<I", len(names))
            body += _pad(len(body), 8)
            offsets.append(len(HEADER) + len(body))
            body += bytes(8 * len(names))
        formats = ["<i4", "<u4", *(("<f8", (len(names),)) for _ in offsets)]
        fields = {"sec": 4, "nanosec": 8, **dict(zip(("position", "velocity", "effort"), offsets, strict=True))}
        self._template = np.frombuffer(HEADER + body, np.uint8)
        self._dtype = np.dtype(
            {"names": list(fields), "formats": formats, "offsets": list(fields.values()), "itemsize": 4 + len(body)}
        )  # type: ignore[call-overload]

    def encode(
        self, stamp_ns: NDArray[np.int64], position: ArrayLike, velocity: ArrayLike, effort: ArrayLike
    ) -> list[bytes]:
        """Return a message for each of n stamps (n,); position, velocity and effort are (n, joints)."""
        rows = np.tile(self._template, (len(stamp_ns), 1)).view(self._dtype)[:, 0]
        rows["sec"], rows["nanosec"] = stamp_ns // 10**9, stamp_ns % 10**9
        rows["position"], rows["velocity"], rows["effort"] = position, velocity, effort
        return [row.tobytes() for row in rows]


def _image_head(stamp_ns: int, height: int, width: int, frame_id: str) -> bytes:
    body = _text(_stamp(stamp_ns), frame_id)
    body += _pad(len(body), 4) + struct.pack("<II", height, width)
    body = _text(body, "mono8") + b"\x00"
    return HEADER + body + _pad(len(body), 4) + struct.pack("<II", width, height * width)


def encode_image(stamp_ns: int, pixels: NDArray[np.uint8], frame_id: str = "camera") -> bytes:
    """Return a grey image (height, width) as sensor_msgs/Image, mono8."""
    height, width = pixels.shape
    return _image_head(stamp_ns, height, width, frame_id) + np.ascontiguousarray(pixels).tobytes()


def decode_image(data: bytes, frame_id: str = "camera") -> NDArray[np.uint8]:
    """Return the pixels (height, width) of what `encode_image` made; `ValueError` for anything else."""
    start = len(_image_head(0, 0, 0, frame_id))
    if len(data) < start:
        raise ValueError(f"image: got {len(data)} bytes, allowed is >= {start}")
    width, size = struct.unpack_from("<II", data, start - 8)
    if len(data) != start + size or width == 0 or size % width:
        raise ValueError(f"image: got {len(data)} bytes for rows of {width}, allowed is mono8 of frame {frame_id}")
    return np.frombuffer(data, np.uint8, size, start).reshape(-1, width)
