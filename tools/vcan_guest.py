"""A Linux guest that has CAN where this machine's kernel has none: user-mode Linux, an ordinary process.

The guest's root is this machine's file system (hostfs), so the same virtual environment runs inside. Its console
is a pipe that is copied to an output as it comes; the command's exit status comes back through a file.
"""

from __future__ import annotations

import os
import selectors
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

from preshape.tools.vcan_host import FD_MTU, VcanUnavailable

KERNEL = "linux.uml"
"""The guest's kernel; Debian's package user-mode-linux has it, and its modules below `MODULES`."""
MODULES = Path("/usr/lib/uml/modules")
CAN_MODULES = ("net/can/can", "net/can/can-raw", "drivers/net/can/dev/can-dev", "drivers/net/can/vcan")
COMPILER = "tcc"
NEEDED = {KERNEL: "user-mode-linux", "insmod": "kmod", "ip": "iproute2", COMPILER: "tcc"}
"""Program -> the Debian package it comes in."""
REGISTERS = Path(__file__).with_name("guest_registers.c")
"""What the kernel preloads to run on every processor."""
SYSTEM_PATH = "/usr/local/sbin:/usr/sbin:/sbin:/usr/local/bin:/usr/bin:/bin"

MEMORY_MIB = 3072
POWER_OFF_S = 5.0
"""How long a guest may take to end after its console is closed, s."""
TIMED_OUT = 124
"""Exit status of a command that was ended at its time limit, as that of `timeout`."""
LOG_TAIL = 600
"""So many characters of the kernel's log go into the message about a guest that did not come up."""


def missing_packages() -> list[str]:
    """Return the Debian packages that a guest needs and that are not installed."""
    missing = [package for program, package in NEEDED.items() if shutil.which(program, path=_wide_path()) is None]
    if KERNEL not in missing and not any(MODULES.glob("*/kernel/drivers/net/can/vcan.ko")):
        missing.append(NEEDED[KERNEL])
    return sorted(set(missing))


def init_script(
    command: Sequence[str], interfaces: Sequence[str], status: Path, cwd: Path, environment: Mapping[str, str]
) -> str:
    """Return the guest's first process: modules, interfaces, the command, its exit status to a file, power off."""
    variables = [f"{name}={value}" for name, value in environment.items()]
    lines = [
        "#!/bin/sh",
        f"PATH={SYSTEM_PATH}; export PATH",
        "exec </dev/null >/dev/ttyS0 2>&1",
        "stty -opost -F /dev/ttyS0",
        "mount -t proc proc /proc && mount -t sysfs sys /sys",
        "mkdir -p /dev/shm /dev/pts && mount -t tmpfs tmpfs /dev/shm && mount -t devpts devpts /dev/pts",
        *(f"insmod {MODULES}/$(uname -r)/kernel/{module}.ko" for module in CAN_MODULES),
        "ip link set lo up",
    ]
    for interface in interfaces:
        name = shlex.quote(interface)
        lines += [f"ip link add {name} type vcan", f"ip link set {name} mtu {FD_MTU} up"]
    lines += [
        f"cd {shlex.quote(str(cwd))}",
        # Through a pipe, for it is no terminal; a process that is left behind may keep the pipe open.
        "mkfifo /dev/shm/printed",
        "cat /dev/shm/printed & copier=$!",
        f"env -i {shlex.join(variables)} {shlex.join(command)} >/dev/shm/printed 2>&1",
        f"echo $? > {shlex.quote(str(status))}",
        "for wait in 1 2 3 4 5; do kill -0 $copier 2>/dev/null && sleep 0.1; done",
        "echo o > /proc/sysrq-trigger",
        "sleep 60",
        "",
    ]
    return "\n".join(lines)


def run_in_guest(command: Sequence[str], interfaces: Sequence[str], time_limit_s: float, output: BinaryIO) -> int:
    """Run a command in a guest that has the interfaces; copy what it prints to `output`, return its exit status.

    The command gets this process' directory and environment, and no input.

    Raises:
        VcanUnavailable: a package is missing, or the guest did not come up.
    """
    if missing := missing_packages():
        raise VcanUnavailable(f"no guest with CAN either: sudo apt-get install {' '.join(missing)}")
    with tempfile.TemporaryDirectory(prefix="preshape-vcan-") as name:
        directory = Path(name)
        status, script, log = directory / "status", directory / "init", directory / "kernel.log"
        script.write_text(init_script(command, interfaces, status, Path.cwd(), os.environ))
        script.chmod(0o700)
        if not _boot(script, log, time_limit_s, output):
            return TIMED_OUT
        if not status.exists():
            tail = " ".join(log.read_text(errors="replace")[-LOG_TAIL:].split())
            raise VcanUnavailable(f"the guest ended without the command's exit status; its kernel's last words: {tail}")
        return int(status.read_text())


def kernel_arguments(script: Path, console: int) -> list[str]:
    """Return the command that boots a guest whose first serial line is a file descriptor of this process."""
    return [
        KERNEL, f"mem={MEMORY_MIB}M", "rootfstype=hostfs", "rootflags=/", "rw", f"init={script}",
        "con=null", "ssl=null", f"ssl0=null,fd:{console}", "quiet",
    ]  # fmt: skip


def _boot(script: Path, log: Path, time_limit_s: float, output: BinaryIO) -> bool:
    """Run a guest to its end; return whether it ended by itself."""
    environment = _kernel_environment(script.parent)
    reading, writing = os.pipe()
    try:
        with log.open("wb") as words:
            guest = subprocess.Popen(
                kernel_arguments(script, writing), stdin=subprocess.DEVNULL, stdout=words, stderr=words,
                pass_fds=(writing,), env=environment, start_new_session=True,
            )  # fmt: skip
    finally:
        os.close(writing)
    ended = False
    try:
        ended = _copy(reading, output, time.monotonic() + time_limit_s)
    finally:
        os.close(reading)
        _end(guest, POWER_OFF_S if ended else 0.0)
    return ended


def _copy(reading: int, output: BinaryIO, deadline_s: float) -> bool:
    """Copy until the pipe's other end is closed; return whether that came before the deadline."""
    with selectors.DefaultSelector() as selector:
        selector.register(reading, selectors.EVENT_READ)
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            if not selector.select(left_s):
                return False
            chunk = os.read(reading, 65536)
            if not chunk:
                return True
            output.write(chunk)
            output.flush()
    return False


def _end(guest: subprocess.Popen[bytes], patience_s: float) -> None:
    """Wait for a guest that switches itself off; kill all its processes where it does not."""
    try:
        guest.wait(timeout=patience_s)
    except subprocess.TimeoutExpired:
        os.killpg(guest.pid, signal.SIGKILL)
        guest.wait()


def _kernel_environment(directory: Path) -> dict[str, str]:
    """Return the kernel's own environment: its memory is a file, in /dev/shm only where that is large enough."""
    room = shutil.disk_usage("/dev/shm").free if Path("/dev/shm").is_dir() else 0
    memory = "/dev/shm" if room > MEMORY_MIB << 20 else str(directory)
    preloaded = str(_compiled_registers(directory))
    return {"PATH": _wide_path(), "HOME": str(directory), "TMPDIR": memory, "LD_PRELOAD": preloaded}


def _compiled_registers(directory: Path) -> Path:
    """Compile `REGISTERS` into a directory and return the library; `VcanUnavailable` if the compiler will not."""
    library = directory / "registers.so"
    command = [COMPILER, "-shared", "-nostdlib", "-o", str(library), str(REGISTERS)]
    done = subprocess.run(command, capture_output=True, text=True, env={"PATH": _wide_path()}, check=False)
    if done.returncode != 0:
        raise VcanUnavailable(f"no guest with CAN either: {shlex.join(command)}: {done.stderr.strip()}")
    return library


def _wide_path() -> str:
    return f"{os.environ.get('PATH', '')}:{SYSTEM_PATH}"
