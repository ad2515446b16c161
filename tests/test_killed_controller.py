"""A controller that is killed in the middle of driving real processes over multicast buses, and the one after it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection

import numpy as np
import pytest
from bus_processes import multicast_addresses, multicast_driver
from killed_controller import ModuleNotes, drive, serve_with_notes

from preshape.hal.can.bus_address import BusAddress
from preshape.hal.can.device import CanDevice
from preshape.hal.can.topology import TOPOLOGY
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState
from preshape.sim_backend.bus_joints import BusWiring

pytestmark = [pytest.mark.bus, pytest.mark.slow]

PATIENCE = 250
"""Cycles until a module stops by itself: a machine that is busy stalls a controller for longer than five."""
CYCLE_NS = 2_000_000
HELD_NS = PATIENCE * CYCLE_NS + 10_000_000


@pytest.fixture
def addresses() -> dict[str, BusAddress]:
    return multicast_addresses()


@pytest.fixture
def modules(addresses: dict[str, BusAddress]) -> Iterator[Connection]:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    wiring = BusWiring(TOPOLOGY, addresses, PATIENCE)
    child = context.Process(target=serve_with_notes, args=(wiring, there), daemon=True)
    child.start()
    there.close()
    assert here.poll(120.0) and here.recv() == "ready"
    yield here
    here.send("end")
    child.join(10.0)
    child.kill()


def _notes(modules: Connection) -> dict[int, ModuleNotes]:
    modules.send("notes")
    assert modules.poll(30.0)
    return modules.recv()


def _read_for(driver: CanDevice, seconds: float, status: DeviceStatus | None = None) -> RobotState:
    end_s = time.monotonic() + seconds
    while True:
        state = driver.read(time.monotonic_ns())
        if state.status is status or time.monotonic() > end_s:
            return state
        time.sleep(0.001)


def test_modules_of_a_killed_controller_hold_by_themselves_and_obey_the_next_only_when_armed(
    modules: Connection, addresses: dict[str, BusAddress]
) -> None:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    controller = context.Process(target=drive, args=(addresses, PATIENCE, there), daemon=True)
    controller.start()
    there.close()
    assert here.poll(120.0) and here.recv() == "driving"
    assert {notes.state for notes in _notes(modules).values()} == {"ARMED"}
    assert controller.pid is not None
    os.kill(controller.pid, signal.SIGKILL)
    controller.join(10.0)

    deadline_s = time.monotonic() + 60.0
    held = _notes(modules)
    while any(notes.state == "ARMED" for notes in held.values()):
        assert time.monotonic() < deadline_s
        time.sleep(0.05)
        held = _notes(modules)
    assert len(held) == len(TOPOLOGY.modules)
    for notes in held.values():
        assert (notes.state, notes.cause) == ("FAULT", "watchdog")
        assert 0 < notes.changed_ns - notes.taken_ns <= HELD_NS

    driver = multicast_driver(addresses, PATIENCE)
    driver.open()
    try:
        state = _read_for(driver, 0.5)
        assert state.status is DeviceStatus.DISARMED and np.isfinite(state.position).all()
        assert not driver.write(_command(1, state.position + 0.05), time.monotonic_ns())
        assert {notes.state for notes in _notes(modules).values()} == {"FAULT"}
        driver.arm(time.monotonic_ns())
        armed = _read_for(driver, 30.0, DeviceStatus.ARMED)
        assert armed.status is DeviceStatus.ARMED, armed.fault
        assert driver.write(_command(2, armed.position), time.monotonic_ns())
        assert {notes.state for notes in _notes(modules).values()} == {"ARMED"}
    finally:
        driver.close()


def _command(sequence: int, position: np.ndarray) -> RobotCommand:
    return RobotCommand(sequence, Mode.POSITION, position, LAYOUT.torque)
