"""The law of what is received: whatever comes, decoding ends with a value or a `ValueError`."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from preshape.hal.received_json import decode_received
from preshape.hal.remote_calls import Question, Reply, Seen
from preshape.tools.telemetry_messages import AnyMessage
from preshape.tools.telemetry_requests import Request

DECODERS = [msgspec.json.Decoder(kind) for kind in (Question, Reply, Seen, Request, AnyMessage)]
NAMES = ["schema", "client", "now_ns", "reason", "arguments", "world", "seq", "expires_ns", "value", "more"]

nested = st.tuples(st.sampled_from([b"[", b'{"a":']), st.integers(0, 4000)).map(lambda pair: pair[0] * pair[1])
plain = st.sampled_from([b"1", b"-1", b"1e308", b"2" * 40, b'"x"', b"null", b"true", b"[]", b'{"a":[1,{}]}', b'"\xff"'])
fields = st.lists(st.tuples(st.sampled_from(NAMES), nested | plain | st.binary(max_size=20)), max_size=4)
objects = fields.map(
    lambda pairs: b"{" + b",".join(b'"' + name.encode() + b'":' + value for name, value in pairs) + b"}"
)


@pytest.mark.parametrize("decoder", DECODERS)
@given(payload=st.binary() | objects)
def test_any_bytes_are_read_or_refused(decoder: msgspec.json.Decoder[Any], payload: bytes) -> None:
    try:
        decode_received(decoder, payload)
    except ValueError as refused:
        assert str(refused)


@pytest.mark.parametrize("decoder", DECODERS)
@pytest.mark.parametrize("name", NAMES)
def test_what_is_nested_without_end_is_refused(decoder: msgspec.json.Decoder[Any], name: str) -> None:
    for opening in (b"[", b'{"a":'):
        with pytest.raises(msgspec.DecodeError):
            decode_received(decoder, b'{"client":1,"now_ns":1,"' + name.encode() + b'":' + opening * 4000)
