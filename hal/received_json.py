"""JSON that came from somebody else: whatever is in it, decoding ends with a value or a `ValueError`."""

from __future__ import annotations

from typing import TypeVar

import msgspec

T = TypeVar("T")


def decode_received(decoder: msgspec.json.Decoder[T], payload: bytes) -> T:
    """Return the value in JSON.

    Raises:
        msgspec.DecodeError: a `ValueError` that names what is wrong: no JSON, not of this type, no UTF-8, or nested
            so deeply that nobody reads it to its end.
    """
    try:
        return decoder.decode(payload)
    except (RecursionError, UnicodeDecodeError) as error:
        raise msgspec.DecodeError(str(error)) from error
