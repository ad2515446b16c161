"""Virtual CAN interfaces of this machine's own kernel: are they there, and can they be made?"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
from collections.abc import Sequence
from pathlib import Path

FD_MTU = 72
"""MTU of an interface that carries CAN FD frames, bytes (`struct canfd_frame`)."""
COMMAND_S = 10.0
"""How long `ip` and `modprobe` may take, s."""


class VcanUnavailable(Exception):
    """There is no virtual CAN bus and none can be made; the message says in one line what to do."""


def kernel_has_can() -> bool:
    """Return whether this kernel opens CAN sockets at all."""
    try:
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW):
            return True
    except (AttributeError, OSError):
        return False


def set_up_commands(interface: str) -> list[list[str]]:
    """Return the commands that make a virtual CAN interface for FD frames, in order; they need root."""
    return [
        ["modprobe", "vcan"],
        ["ip", "link", "add", interface, "type", "vcan"],
        ["ip", "link", "set", interface, "mtu", str(FD_MTU), "up"],
    ]


def is_ready(interface: str) -> bool:
    """Return whether an interface exists, is up and carries FD frames."""
    directory = Path("/sys/class/net") / interface
    try:
        up = int((directory / "flags").read_text(), 16) & 1
        return bool(up) and int((directory / "mtu").read_text()) >= FD_MTU
    except OSError:
        return False


def ensure_interfaces(interfaces: Sequence[str]) -> None:
    """Make every interface that is not ready.

    Raises:
        VcanUnavailable: the kernel has no CAN, or the interfaces are missing and this user may not make them.
    """
    if not kernel_has_can():
        raise VcanUnavailable("this kernel has no CAN sockets (AF_CAN)")
    for interface in interfaces:
        if not is_ready(interface):
            _make(interface)


def _make(interface: str) -> None:
    prefix = [] if os.geteuid() == 0 else ["sudo", "-n"]
    failures = [
        failure
        for command in set_up_commands(interface)
        if (failure := _failure_of([*prefix, *command])) and not is_ready(interface)
    ]
    if not is_ready(interface):
        recipe = " && ".join(f"sudo {' '.join(command)}" for command in set_up_commands(interface))
        raise VcanUnavailable(f"{interface} is not there ({'; '.join(dict.fromkeys(failures)) or 'not up'}): {recipe}")


def _failure_of(command: Sequence[str]) -> str:
    """Run a command; return what went wrong, empty if nothing did."""
    if shutil.which(command[0]) is None:
        return f"{command[0]} is not installed"
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND_S, check=False)
    except subprocess.TimeoutExpired:
        return f"{' '.join(command)} did not end within {COMMAND_S:g} s"
    return ended.stderr.strip().replace("\n", ", ") if ended.returncode else ""
