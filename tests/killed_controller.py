"""Processes for the test that kills a controller: modules that keep notes in their own time, and their driver."""

from __future__ import annotations

import signal
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

from bus_processes import multicast_driver

from preshape.hal.can.bus_address import BusAddress
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand
from preshape.sim_backend.bare_robot import BareRobot
from preshape.sim_backend.bus_joints import BusJoints, BusWiring
from preshape.sim_backend.real_pace import RealPace


@dataclass(frozen=True, slots=True)
class ModuleNotes:
    """One module's state, when it last took a command, and when and why its state last changed, in its own time."""

    state: str
    taken_ns: int
    changed_ns: int
    cause: str


def serve_with_notes(wiring: BusWiring, line: Connection) -> None:
    """Run modules before the bare robot; answer "notes" by node, end at "end"."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    robot = BareRobot(0)
    joints = BusJoints(robot, wiring)
    modules = joints.rack.modules
    counts, taken_ns = dict.fromkeys(modules, 0), dict.fromkeys(modules, 0)
    pace = RealPace()
    pace.begin(robot.time_ns)
    line.send("ready")
    while True:
        robot.step()
        for node, module in modules.items():
            if module.counts["taken"] != counts[node]:
                counts[node], taken_ns[node] = module.counts["taken"], robot.time_ns
        if line.poll():
            if line.recv() == "end":
                break
            line.send({
                node: ModuleNotes(module.state.name, taken_ns[node], event.time_ns, event.cause)
                for node, module in modules.items() if (event := module.events[-1])
            })  # fmt: skip
        pace.wait(robot.time_ns)
    joints.close()


def drive(addresses: dict[str, BusAddress], patience: int, line: Connection) -> None:
    """Arm the modules and hold them where they are by a command every two milliseconds, until killed."""
    driver = multicast_driver(addresses, patience)
    driver.open()
    now_ns = time.monotonic_ns()
    while driver.missing:
        driver.read(time.monotonic_ns())
        time.sleep(0.002)
    driver.arm(time.monotonic_ns())
    sequence, told, target = 0, False, None
    while True:
        now_ns += 2_000_000
        time.sleep(max(0.0, (now_ns - time.monotonic_ns()) * 1e-9))
        now_ns = max(now_ns, time.monotonic_ns() - 2_000_000)
        state = driver.read(time.monotonic_ns())
        if state.status is not DeviceStatus.ARMED:
            continue
        target = state.position if target is None else target
        sequence += 1
        driver.write(RobotCommand(sequence, Mode.POSITION, target, LAYOUT.torque), time.monotonic_ns())
        if not told and sequence > 50:
            told = True
            line.send("driving")
