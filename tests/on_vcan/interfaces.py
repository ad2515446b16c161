"""What the driver makes of interfaces that are missing or go down; run where vcan0 .. vcan2 are up."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import pytest
from can_rig import CanRig, VcanRig

from preshape.hal.can.bus_address import BusAddress, open_bus
from preshape.hal.can.vocabulary import ModuleState
from preshape.hal.device import DeviceUnreachable
from preshape.hal.state import DeviceStatus

COORDINATED_S, HELD_S = 0.020, 5 * 0.002 + 0.010


def _set(interface: str, how: str) -> None:
    subprocess.run(["/usr/sbin/ip", "link", "set", interface, how], check=True)


@pytest.fixture
def rig() -> Iterator[CanRig]:
    rig = VcanRig().ready()
    yield rig
    _set("vcan1", "up")
    rig.close()


def test_a_missing_interface_is_one_line_that_says_how_to_make_it() -> None:
    with pytest.raises(DeviceUnreachable) as caught:
        open_bus(BusAddress("socketcan", "vcan9"), "fd")
    assert str(caught.value) == (
        "bus socketcan vcan9: no interface vcan9: sudo ip link add vcan9 type vcan && sudo ip link set vcan9 mtu 72 up"
    )


def test_an_interface_that_goes_down_stops_everything_in_time_and_modules_hold_by_themselves(rig: CanRig) -> None:
    goal = rig.read().position
    for _ in range(10):
        rig.write(goal)
        rig.wait(rig.period_s)
    _set("vcan1", "down")
    down_ns = rig.clock.now_ns()
    while rig.read().status is DeviceStatus.ARMED:
        rig.write(goal)
        rig.wait(rig.period_s)
        assert rig.clock.now_ns() - down_ns <= COORDINATED_S * 1e9
    state = rig.wait(0.05)
    assert state.status is DeviceStatus.FAULT
    assert "left_hand" in state.fault
    assert not rig.write(goal)
    for module in rig.rack.modules.values():
        assert module.state is not ModuleState.ARMED
        assert module.events[-1].time_ns - down_ns <= HELD_S * 1e9 + COORDINATED_S * 1e9


def test_after_the_interface_is_up_again_nothing_moves_until_it_is_armed(rig: CanRig) -> None:
    _set("vcan1", "down")
    rig.wait(0.05)
    _set("vcan1", "up")
    state = rig.wait(0.1)
    assert state.status is DeviceStatus.FAULT
    assert all(module.state is not ModuleState.ARMED for module in rig.rack.modules.values())
    armed = rig.arm()
    assert rig.write(armed.position)
