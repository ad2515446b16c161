"""A device served by a process of its own, for tests."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import zenoh
from zenoh_robot import free_endpoint

from preshape.tools.zenoh_session import client_settings, open_session

ROOT = "preshape/box/device"
_PROGRAM = "from preshape.tools.cli import main; main()"


@dataclass
class Served:
    """The process and where it listens."""

    process: subprocess.Popen[str]
    endpoint: str
    said: list[str]

    def session(self) -> zenoh.Session:
        """Return a session that is connected to it."""
        return open_session(client_settings(self.endpoint))

    def signal(self, number: signal.Signals) -> None:
        """Send the process a signal."""
        os.kill(self.process.pid, number)


@contextmanager
def served(*arguments: str) -> Iterator[Served]:
    """Serve MuJoCo until the test is over."""
    endpoint = free_endpoint()
    # These tests are not about time: joints are patient on machines that stall.
    patient = ["--patience-cycles", "200"]
    command = [sys.executable, "-c", _PROGRAM, "serve", "--endpoint", endpoint, *patient, *arguments]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        first = process.stderr.readline()
        assert "serving" in first, first + process.stderr.read()
        yield Served(process, endpoint, [first])
    finally:
        process.kill()
        process.wait()
        process.stderr.close()
