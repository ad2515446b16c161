"""An answer of the perception with its image as one message, for a ring to another process."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from preshape.hal.answers import AnyAnswer, decode_answer, encode_answer


def pack(answer: AnyAnswer, pixels: NDArray[np.uint8] | None) -> bytes:
    """Return an answer and its image as one message."""
    text = encode_answer(answer)
    height, width = (0, 0) if pixels is None else pixels.shape
    return struct.pack("<III", len(text), height, width) + text + (b"" if pixels is None else pixels.tobytes())


def unpack(message: bytes) -> tuple[AnyAnswer, NDArray[np.uint8] | None]:
    """Return what `pack` has packed."""
    size, height, width = struct.unpack_from("<III", message)
    answer = decode_answer(message[12 : 12 + size])
    pixels = np.frombuffer(message, np.uint8, height * width, 12 + size).reshape(height, width)
    return answer, pixels if height else None
