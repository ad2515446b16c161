"""Run a command where there is a virtual CAN bus: on this machine, or in a guest when its kernel has none.

python -m preshape.tools.with_vcan -- candump -n 1 vcan0
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from io import FileIO
from typing import BinaryIO, NoReturn

from preshape.tools.exit_codes import ExitCode
from preshape.tools.vcan_guest import TIMED_OUT, run_in_guest
from preshape.tools.vcan_host import VcanUnavailable, ensure_interfaces

TIME_LIMIT_S = 120.0


def run_with_vcan(
    command: Sequence[str],
    interfaces: Sequence[str] = ("vcan0",),
    time_limit_s: float = TIME_LIMIT_S,
    output: BinaryIO | None = None,
) -> int:
    """Run a command that finds the interfaces up, for FD frames; return its exit status, 124 at the time limit.

    Its input is empty; what it prints, on either stream, goes to `output` (default: this process' own) as it comes.

    Raises:
        VcanUnavailable: neither this kernel nor a guest can give the interfaces.
        ValueError: no command, no interface, or a time limit that is not positive.
    """
    if not command or not interfaces or not time_limit_s > 0.0:
        raise ValueError(
            f"got command {list(command)}, interfaces {list(interfaces)}, time limit {time_limit_s} s; "
            "allowed are at least one word, at least one interface, more than 0 s"
        )
    sink = sys.stdout.buffer if output is None else output
    try:
        ensure_interfaces(interfaces)
    except VcanUnavailable as here:
        try:
            return run_in_guest(command, interfaces, time_limit_s, sink)
        except VcanUnavailable as there:
            raise VcanUnavailable(f"no virtual CAN bus: {here}; {there}") from None
    return _run_here(command, time_limit_s, sink)


def _run_here(command: Sequence[str], time_limit_s: float, output: BinaryIO) -> int:
    reading, writing = os.pipe()
    with open(reading, "rb", buffering=0) as printed:
        try:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=writing, stderr=subprocess.STDOUT, start_new_session=True
            )
        finally:
            os.close(writing)
        copier = threading.Thread(target=_copy, args=(printed, output))
        copier.start()
        try:
            status = process.wait(timeout=time_limit_s)
            return status if status >= 0 else 128 - status
        except subprocess.TimeoutExpired:
            return TIMED_OUT
        finally:
            _end_group(process)
            copier.join()


def _copy(printed: FileIO, output: BinaryIO) -> None:
    """Copy until nobody can print any more."""
    while chunk := printed.read(65536):
        output.write(chunk)
        output.flush()


def _end_group(process: subprocess.Popen[bytes]) -> None:
    """Leave none of the command's processes behind, as the end of a guest does."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    process.wait()


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Read the command line, run the command, exit with its status (3: no virtual CAN bus)."""
    parser = argparse.ArgumentParser(prog="with_vcan", description="Run a command where there is a virtual CAN bus.")
    parser.add_argument("--interfaces", nargs="+", default=["vcan0"], metavar="NAME", help="default: vcan0")
    parser.add_argument("--time-limit-s", type=float, default=TIME_LIMIT_S, help="default: %(default)g")
    words = list(sys.argv[1:] if arguments is None else arguments)
    if "--" not in words:
        parser.error("put -- before the command")
    split = words.index("--")
    options = parser.parse_args(words[:split])
    try:
        sys.exit(run_with_vcan(words[split + 1 :], options.interfaces, options.time_limit_s))
    except ValueError as error:
        parser.error(str(error))
    except VcanUnavailable as error:
        print(f"with_vcan: {error}", file=sys.stderr)
        sys.exit(ExitCode.UNREACHABLE)


if __name__ == "__main__":
    main()
