"""Kill one side of a run across processes in the middle of each task, and see what the other side makes of it.

`python -m preshape.tools.kill_in_tasks --device can --victim controller`: joint modules and scene are those of a
`preshape hand-bus`, the controller is a `preshape run --attach`; with `--device zenoh` the scene is a `preshape serve`.
The victim gets SIGKILL. Left alone, modules must hold by themselves within five cycles and 10 ms of their own time and
served joints must be stopped, with no torque above its limit; a controller must end by a safety stop, or an unreachable
device, with the reason in words.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NoReturn

from preshape.control.box_opening import TASK_NAMES
from preshape.hal.can.topology import TOPOLOGY
from preshape.sim_backend.referee_report import TORQUE_RATIO_ALLOWED
from preshape.tools.exit_codes import ExitCode
from preshape.tools.run_options import MESSAGES_RATE_HZ
from preshape.tools.wire_rules import stop_limit_s

PRESHAPE = (sys.executable, "-c", "from preshape.tools.cli import main; main()")
READY_S, TASK_S, END_S = 120.0, 400.0, 60.0
"""Longest time until a world is up, until a task begins and until a process ends, s."""
LEFT_ALONE_S = 1.0
"""How long modules or served joints are left to themselves, s of their own time."""
REASON = "safety stop"
"""What the line holds by which a controller says how it ended."""
MODULES = len(TOPOLOGY.modules)


class Background:
    """A process in a session of its own whose output goes into a file."""

    def __init__(self, arguments: Sequence[str], output: Path) -> None:
        """Start it."""
        self._output = output
        with output.open("w") as file:
            self.process = subprocess.Popen(
                [*PRESHAPE, *arguments], stdout=file, stderr=subprocess.STDOUT, start_new_session=True
            )

    @property
    def text(self) -> str:
        """What it has printed so far."""
        return self._output.read_text()

    def wait_for(self, words: str, seconds: float) -> bool:
        """Wait until it has printed something; False if it ends before, or the time is over."""
        deadline_s = time.monotonic() + seconds
        while words not in self.text:
            if self.process.poll() is not None or time.monotonic() > deadline_s:
                return words in self.text
            time.sleep(0.02)
        return True

    def end(self, number: int) -> int | None:
        """Send it a signal and return its exit code, None if it had to be killed."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.wait()

    def wait(self) -> int | None:
        """Return its exit code, None if it did not end in time and was killed with all its children."""
        try:
            return self.process.wait(END_S)
        except subprocess.TimeoutExpired:
            return None

    def clear(self) -> None:
        """Leave nothing of it behind."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()


def kill_in(task: int, device: str, victim: str, seed: int, pace: float, later_s: float, folder: Path) -> list[str]:
    """Run until a task has begun, kill the victim some time later (s of the scene), and return what was wrong."""
    chosen = ("--scenario", "tea_box", "--seed", str(seed))
    bus = ("--interface", "udp_multicast")
    if device == "can":
        world = Background(("hand-bus", *bus, "--pace", f"{pace:g}", *chosen), folder / f"world{task}.txt")
        run = ("run", "--device", "can", "--attach", *bus)
    else:
        world = Background(("serve", *chosen), folder / f"world{task}.txt")
        run = ("run", "--device", "zenoh")
    out = folder / f"run{task}"
    controller = None
    try:
        if not world.wait_for("ready: " if device == "can" else "serving ", READY_S):
            return [f"the world did not come up: {world.text}"]
        controller = Background((*run, *chosen, "--no-pictures", "--out", str(out)), folder / f"controller{task}.txt")
        if not controller.wait_for(f" task {task} ", TASK_S):
            return [f"task {task} did not begin: {controller.text}"]
        time.sleep(later_s / pace)
        if controller.process.poll() is not None:
            return [f"the run ended by itself, before anything was killed: {controller.text}"]
        where = controller.text.strip().rpartition("\n")[2].strip()
        killed, other = (controller, world) if victim == "controller" else (world, controller)
        killed.process.send_signal(signal.SIGKILL)
        killed.process.wait()
        if victim == "world":
            code = other.wait()
            why = next((line.strip() for line in other.text.splitlines() if REASON in line), "")
            print(f"killed in {where!r}: the controller ended with {code}: {why}", flush=True)
            good = code in (ExitCode.SAFETY_STOP, ExitCode.UNREACHABLE) and why
            return [] if good else [f"the controller ended with {code}: {other.text}"]
        time.sleep(LEFT_ALONE_S / pace)
        other.end(signal.SIGINT)
        print(f"killed in {where!r}:")
        print("\n".join(f"    {line}" for line in _after_arming(other.text)), flush=True)
        return faults_of_modules(other.text) if device == "can" else faults_of_served(other.text)
    finally:
        for process in (controller, world):
            if process is not None:
                process.clear()


def _after_arming(text: str) -> list[str]:
    lines = text.splitlines()
    armed = [number for number, line in enumerate(lines) if "armed" in line and "disarmed" not in line]
    return lines[armed[0] :] if armed else lines


def faults_of_modules(text: str) -> list[str]:
    """Return what the modules' log, as a hand bus prints it, says against them."""
    limit_ms = 1e3 * stop_limit_s(1.0 / MESSAGES_RATE_HZ)
    faults: list[str] = []
    stopped = 0
    for line in text.splitlines():
        found = re.search(r"fault \(watchdog, (\d+) ms after the last command\): (.*)", line)
        if found is None:
            continue
        stopped += MODULES if found[2] == "all modules" else len(found[2].split(", "))
        if float(found[1]) > limit_ms:
            faults.append(f"{line.strip()}: later than {limit_ms:g} ms")
    if stopped != MODULES:
        faults.append(f"{stopped} of {MODULES} modules stopped by themselves")
    return faults + _torque_faults(text)


def faults_of_served(text: str) -> list[str]:
    """Return what a server's notes say against the joints that it has served."""
    faults = [] if "stopped: the client has gone" in text else ["the joints were not stopped"]
    return faults + _torque_faults(text)


def _torque_faults(text: str) -> list[str]:
    found = re.search(r"largest torque in physics: ([0-9.]+)", text)
    if found is None:
        return ["nothing is said of torque"]
    return [] if float(found[1]) <= TORQUE_RATIO_ALLOWED else [f"torque {found[1]} of its limit"]


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Kill and print; exit with 0 when all was as it must be, else 1."""
    parser = argparse.ArgumentParser(prog="kill_in_tasks", description="Kill one side of a run in each task.")
    parser.add_argument("--device", choices=("can", "zenoh"), default="can", help="default: %(default)s")
    parser.add_argument("--victim", choices=("controller", "world"), default="controller", help="default: %(default)s")
    parser.add_argument(
        "--tasks", type=int, nargs="+", default=list(range(1, len(TASK_NAMES) + 1)), help="default: all five"
    )
    parser.add_argument("--seed", type=int, default=0, help="default: %(default)s")
    parser.add_argument("--later-s", type=float, default=2.0, help="after the task's beginning; default: %(default)g")
    parser.add_argument("--pace", type=float, default=1.0, help="of a hand bus; default: %(default)g")
    options = parser.parse_args(arguments)
    if options.device == "zenoh" and options.pace != 1.0:
        parser.error(f"got --pace {options.pace:g}, allowed is 1 with --device zenoh")
    faults: list[str] = []
    with TemporaryDirectory() as folder:
        for task in options.tasks:
            found = kill_in(
                task, options.device, options.victim, options.seed, options.pace, options.later_s, Path(folder)
            )
            faults += [f"task {task}: {fault}" for fault in found]
    print("\n".join(faults) if faults else f"{len(options.tasks)} of {len(options.tasks)} as it must be")
    sys.exit(ExitCode.TASK_FAILED if faults else ExitCode.DONE)


if __name__ == "__main__":
    main()
