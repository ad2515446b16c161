"""Laws of the CDR messages: what is written is what ROS 2 reads, byte for byte."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from preshape.hal import cdr
from preshape.hal.tick_record import TICK, new_record


class CdrReader:
    """Reads a CDR body field by field, by the rules of the standard."""

    def __init__(self, data: bytes) -> None:
        assert data[:4] == b"\x00\x01\x00\x00"
        self.body, self.at = data[4:], 0

    def one(self, kind: str) -> float:
        size = struct.calcsize(kind)
        self.at += -self.at % size
        (value,) = struct.unpack_from("<" + kind, self.body, self.at)
        self.at += size
        return value

    def text(self) -> str:
        size = int(self.one("I"))
        value = self.body[self.at : self.at + size]
        self.at += size
        assert value[-1] == 0
        return value[:-1].decode()

    def sequence(self, kind: str) -> list[float]:
        return [self.one(kind) for _ in range(int(self.one("I")))]


@given(st.lists(st.text("abcdefg_1", min_size=1, max_size=9), min_size=1, max_size=14), st.integers(0, 2 * 10**18))
def test_joint_states_are_read_back_field_by_field(names: list[str], stamp_ns: int) -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=(3, 2, len(names)))
    messages = cdr.JointStateLayout(names).encode(np.array([stamp_ns, stamp_ns + 7]), *values)
    for row, data in enumerate(messages):
        reader = CdrReader(data)
        assert reader.one("i") * 10**9 + reader.one("I") == stamp_ns + 7 * row
        assert reader.text() == "world"
        assert [reader.text() for _ in range(int(reader.one("I")))] == names
        for part in values:
            assert reader.sequence("d") == part[row].tolist()
        assert reader.at == len(reader.body)


def test_an_image_is_read_back() -> None:
    pixels = np.arange(15, dtype=np.uint8).reshape(3, 5)
    data = cdr.encode_image(12_000_000_034, pixels)
    reader = CdrReader(data)
    assert (reader.one("i"), reader.one("I"), reader.text()) == (12, 34, "camera")
    assert (reader.one("I"), reader.one("I"), reader.text(), reader.one("B"), reader.one("I")) == (3, 5, "mono8", 0, 5)
    assert reader.sequence("B") == pixels.ravel().tolist()
    assert np.array_equal(cdr.decode_image(data), pixels)
    with pytest.raises(ValueError, match="mono8"):
        cdr.decode_image(data[:-1])


def test_a_ticks_bytes_are_its_message() -> None:
    record = new_record()
    record["tick"], record["fault"], record["task"], record["compute_ns"] = 5, b"lost", 3, 17
    record["position"] = np.arange(40)
    reader = CdrReader(cdr.encode_record(record))
    for line in cdr.record_schema(TICK).splitlines():
        kind, name = line.split()
        kind, _, count = kind.rstrip("]").partition("[")
        code = {"float64": "d", "int64": "q", "int16": "h", "int8": "b", "uint8": "B", "bool": "?"}[kind]
        values = [reader.one(code) for _ in range(int(count or 1))]
        field = next(field for field in TICK.names or () if field.lower() == name)
        wanted = record[field]
        if TICK[field].kind == "S":
            assert bytes(int(value) for value in values).rstrip(b"\x00") == wanted.item()
        else:
            assert np.array_equal(np.array(values, wanted.dtype), wanted.ravel(), equal_nan=wanted.dtype.kind == "f")
    assert reader.at == len(reader.body)
    assert cdr.decode_record(cdr.encode_record(record), TICK).tobytes() == record.tobytes()


@pytest.mark.parametrize(
    "dtype",
    [
        np.dtype([("a", np.int8), ("b", np.float64)]),
        np.dtype([("a", np.float64), ("b", np.int8)], align=True),
        np.dtype([("a", np.complex128)]),
    ],
    ids=["packed", "padded at its end", "complex"],
)
def test_layouts_that_are_not_those_of_cdr_are_refused(dtype: np.dtype) -> None:
    with pytest.raises(ValueError, match="allowed"):
        cdr.record_schema(dtype)
