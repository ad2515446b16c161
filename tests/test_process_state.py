"""What the system says of another process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

from zenoh_robot import until

from preshape.tools.process_state import process_state


def test_a_process_runs_is_stopped_goes_on_and_is_gone() -> None:
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    assert process_state(process.pid) == "running"
    os.kill(process.pid, signal.SIGSTOP)
    assert until(lambda: process_state(process.pid) == "stopped")
    os.kill(process.pid, signal.SIGCONT)
    assert until(lambda: process_state(process.pid) == "running")
    process.kill()
    # It has ended, though nobody has collected it yet.
    assert until(lambda: process_state(process.pid) == "gone")
    process.wait()
    assert process_state(process.pid) == "gone"
