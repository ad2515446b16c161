"""A robot found over Zenoh: waits until it is there, for those who watch or record."""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from preshape.hal.device import DeviceUnreachable
from preshape.tools.telemetry_keys import Keys
from preshape.tools.telemetry_listener import TelemetryListener
from preshape.tools.zenoh_session import client_settings, open_session

RETRY_S = 0.5


@contextmanager
def listening(keys: Keys, endpoint: str, zenoh_config: Path | None, within_s: float) -> Generator[TelemetryListener]:
    """Give a listener to a robot that is there, or comes within a time.

    Raises:
        DeviceUnreachable: it does not.
    """
    deadline_s = time.monotonic() + within_s
    while True:
        try:
            session = open_session(client_settings(endpoint), zenoh_config)
            try:
                listener = TelemetryListener(session, keys)
            except DeviceUnreachable:
                session.close()
                raise
            break
        except DeviceUnreachable:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(RETRY_S)
    try:
        yield listener
    finally:
        listener.close()
        session.close()
