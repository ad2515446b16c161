"""The 11-bit identifiers of the hand bus, after CANopen's: who sends what, and which frame wins arbitration."""

from __future__ import annotations

QUICK_STOP_ID = 0x001
"""Highest priority: every module that sees it stops, whoever sent it and whatever it holds."""
EMERGENCY_BASE = 0x080
COMMAND_BASE = 0x0A0
STATE_BASE = 0x180
REPLY_BASE = 0x580
REQUEST_BASE = 0x600
HEARTBEAT_BASE = 0x700

NODES = range(1, COMMAND_BASE - EMERGENCY_BASE)
"""Node numbers that keep every identifier in its own block."""
GROUPS = range(32)
"""Group numbers: a group of modules shares one command broadcast."""


def command_id(group: int) -> int:
    """Return the identifier of a group's command broadcast, which doubles as its SYNC."""
    return COMMAND_BASE + group


def emergency_id(node: int) -> int:
    """Return the identifier of a module's emergency frame."""
    return EMERGENCY_BASE + node


def state_id(node: int) -> int:
    """Return the identifier of a module's state."""
    return STATE_BASE + node


def request_id(node: int) -> int:
    """Return the identifier of a parameter request to a module."""
    return REQUEST_BASE + node


def reply_id(node: int) -> int:
    """Return the identifier of a module's answer to a parameter request."""
    return REPLY_BASE + node


def heartbeat_id(node: int) -> int:
    """Return the identifier of a module's heartbeat."""
    return HEARTBEAT_BASE + node
