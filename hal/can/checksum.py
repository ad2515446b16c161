"""Checksums over a frame's identifier and content: a frame under another's identifier never passes."""

from __future__ import annotations

from binascii import crc32, crc_hqx

Bytes = bytes | bytearray | memoryview


def crc16(frame_id: int, content: Bytes) -> int:
    """Return CRC-16/CCITT (0x1021) of the content, started with the identifier."""
    return crc_hqx(content, frame_id)


def checksum32(frame_id: int, content: Bytes) -> int:
    """Return CRC-32 (IEEE) of the content, started with the identifier."""
    return crc32(content, frame_id)
