"""What the system says of another process: whether it runs, has been stopped, or is gone."""

from __future__ import annotations

from pathlib import Path

from preshape.tools.telemetry_messages import PartState


def process_state(pid: int) -> PartState:
    """Return "running", "stopped" (by a signal or a debugger) or "gone" (ended, or waiting to be collected)."""
    try:
        words = Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:
        return "gone"
    # The name in parentheses may hold anything; the state is the first letter after the last of them.
    letter = words.rpartition(b")")[2].split()[:1]
    if letter in ([b"T"], [b"t"]):
        return "stopped"
    return "gone" if letter in ([], [b"Z"], [b"X"]) else "running"
