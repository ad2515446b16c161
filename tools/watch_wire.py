"""The passive monitor on a log file or on a live bus: what was on the wire, and which rules were broken.

`python -m preshape.tools.watch_wire runs/.../can.log`, or
`python -m preshape.tools.watch_wire --interface socketcan --channel vcan0 --seconds 10`
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NoReturn

import can

from preshape.tools.exit_codes import ExitCode
from preshape.tools.run_options import MESSAGES_RATE_HZ, RATE_HZ
from preshape.tools.wire_monitor import WireMonitor, WireVerdict
from preshape.tools.wire_rules import STOP_CYCLES

POLL_S = 0.1


def watch(monitor: WireMonitor, frames: Iterable[can.Message], pace: float = 1.0) -> WireVerdict:
    """Tell the monitor of frames, with the time and the channel that each has; return its verdict.

    `pace`: seconds of the modules in each second of the frames' times, as of `preshape hand-bus --pace`; violations
    are told by the modules' time, the frames' times `pace`.
    """
    for frame in frames:
        time_s, data = frame.timestamp * pace, bytes(frame.data)
        monitor.take(time_s, frame.arbitration_id, data, frame.channel, frame.is_error_frame)
    return monitor.verdict()


def frames_of_log(path: Path) -> Iterable[can.Message]:
    """Return the frames of a log file in any format that python-can reads (.log, .blf, .asc, .mf4).

    Raises:
        ValueError: the format is not known.
        OSError: the file cannot be read.
    """
    return can.LogReader(path)


def frames_of_bus(bus: can.BusABC, seconds: float) -> Iterable[can.Message]:
    """Give every frame that a bus hears within a time."""
    deadline_s = time.monotonic() + seconds
    while time.monotonic() < deadline_s:
        frame = bus.recv(POLL_S)
        if frame is not None:
            yield frame


def summary(verdict: WireVerdict) -> str:
    """Return the verdict in lines: frames by name, the largest shares of limits, the violations."""
    width = max((len(name) for name in verdict.frames), default=0)
    lines = [f"{name:<{width}}  {count}" for name, count in verdict.frames.items()]
    lines += [f"unknown identifier {frame_id:#05x}  {count}" for frame_id, count in verdict.unknown.items()]
    lines.append(
        f"damaged {verdict.damaged}, error frames {verdict.errors}; largest torque limit commanded "
        f"{verdict.torque_limit_ratio:.3f}, speed commanded {verdict.speed_ratio:.3f}, torque reported "
        f"{verdict.torque_ratio:.3f} of the joint's limit"
    )
    lines += [str(violation) for violation in verdict.violations]
    broken = ", ".join(f"{rule} {count} times" for rule, count in verdict.broken.items())
    lines.append(f"rules broken: {broken}" if broken else "no rule broken")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Watch and print; exit with 0 when no rule was broken, 1 when one was, 3 when there is nothing to watch."""
    parser = argparse.ArgumentParser(prog="watch_wire", description="Judge the hand bus by the rules of the wire.")
    parser.add_argument("log", nargs="?", type=Path, help="a log file; without it a live bus is watched")
    parser.add_argument("--interface", default="socketcan", help="python-can's name of it; default: %(default)s")
    parser.add_argument("--channel", default="vcan0", help="default: %(default)s")
    parser.add_argument("--seconds", type=float, default=10.0, help="how long; default: %(default)g")
    parser.add_argument(
        "--period-ms",
        type=float,
        help=f"of commands; default: {1e3 / RATE_HZ:g} for a log (lockstep), {1e3 / MESSAGES_RATE_HZ:g} for a live bus",
    )
    parser.add_argument(
        "--patience-cycles", type=int, default=STOP_CYCLES, help="periods without a command; default: %(default)s"
    )
    parser.add_argument("--pace", type=float, default=1.0, help="seconds of the modules in each of the log's")
    options = parser.parse_args(arguments)
    if options.period_ms is None:
        options.period_ms = 1e3 / (MESSAGES_RATE_HZ if options.log is None else RATE_HZ)
    for option in ("period_ms", "seconds", "pace"):
        if not getattr(options, option) > 0.0:
            parser.error(f"--{option.replace('_', '-')}: got {getattr(options, option):g}, allowed is > 0")
    monitor = WireMonitor(options.period_ms * 1e-3, patience_cycles=options.patience_cycles)
    try:
        if options.log is not None:
            verdict = watch(monitor, frames_of_log(options.log), options.pace)
        else:
            with can.Bus(options.channel, interface=options.interface, fd=True) as bus:
                verdict = watch(monitor, frames_of_bus(bus, options.seconds), options.pace)
    except (OSError, ValueError, can.CanError) as error:
        print(f"watch_wire: {error}", file=sys.stderr)
        sys.exit(ExitCode.UNREACHABLE)
    print(summary(verdict))
    sys.exit(ExitCode.DONE if verdict.ok else ExitCode.TASK_FAILED)


if __name__ == "__main__":
    main()
