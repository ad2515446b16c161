"""Asks a running robot how it is."""

from __future__ import annotations

import msgspec
import zenoh

from preshape.hal.device import DeviceUnreachable
from preshape.tools.telemetry_keys import Keys
from preshape.tools.telemetry_requests import Status

ANSWER_S = 1.0
"""Longest time until the answer, s: a stopped process gives none."""


def ask_status(session: zenoh.Session, keys: Keys, within_s: float = ANSWER_S) -> Status:
    """Return the robot's status.

    Raises:
        DeviceUnreachable: no answer in time: no such robot here, or its telemetry process has been stopped.
    """
    for reply in session.get(keys.of("call/status"), timeout=within_s):
        if reply.ok is not None:
            return msgspec.json.decode(reply.ok.payload.to_bytes(), type=Status)
    raise DeviceUnreachable(f"robot {keys.robot}: no answer within {within_s:g} s: not running, or stopped")
