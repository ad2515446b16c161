"""The driver and the modules when things go wrong on the bus: who stops, within which time, and what it takes to go on.

Times are the modules' own, on simulated time; the passive monitor listens to every frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import numpy as np
import pytest
from faulty_rig import FaultyRig, events_of

from preshape.hal.can.device import CanDevice
from preshape.hal.can.topology import TOPOLOGY
from preshape.hal.can.vocabulary import ModuleState
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus
from preshape.sim_backend.fault_plan import FrameFaults

pytestmark = pytest.mark.bus

CYCLE_S = 0.002
HELD_S = 5 * CYCLE_S + 0.010
"""Modules are in damped hold within this time of module time after a failure (5 cycles + 10 ms)."""
COORDINATED_S = 0.020
"""The controller's stop of everything comes within this time of its detection."""
FINGERS = tuple(module.name for module in TOPOLOGY.modules if "hand" in TOPOLOGY.group_of(module).name)


@pytest.fixture
def rig() -> Iterator[FaultyRig]:
    rig = FaultyRig()
    rig.ready()
    rig.begin()
    yield rig
    assert rig.verdict().ok, rig.verdict().violations
    rig.close()


def _module(rig: FaultyRig, name: str) -> int:
    return next(module.node for module in rig.topology.modules if module.name == name)


@pytest.mark.parametrize("name", FINGERS)
def test_when_a_module_dies_the_others_are_in_damped_hold_in_time(rig: FaultyRig, name: str) -> None:
    rig.sway(60 + 7 * FINGERS.index(name))
    rig.rack.modules[_module(rig, name)].power_off()
    died_s = rig.seconds
    state = rig.sway(20)
    assert state.status is DeviceStatus.FAULT
    assert f"module {name}" in state.fault and "lost" in state.fault
    left = rig.left_armed_s()
    assert set(left) == {module.name for module in rig.topology.modules} - {name}
    assert all(0.0 < seconds - died_s <= HELD_S for seconds in left.values()), events_of(rig.rack)
    _stands_still(rig)


def test_the_controller_stops_everything_in_the_call_in_which_it_detects(rig: FaultyRig) -> None:
    rig.sway(50)
    rig.rack.modules[_module(rig, "left_ring")].power_off()
    while rig.read().status is DeviceStatus.ARMED:
        rig.sway(1)
    detected_s = rig.seconds
    rig.wait(0.01)
    assert max(rig.left_armed_s().values()) - detected_s <= COORDINATED_S
    assert rig.verdict().frames["quick_stop"] >= len(rig.topology.buses)


def test_when_the_controller_is_gone_every_module_holds_by_itself_in_time(rig: FaultyRig) -> None:
    rig.sway(50)
    gone_s = rig.seconds
    for _ in range(200):
        rig.robot.step()
    left = rig.left_armed_s()
    assert len(left) == len(rig.topology.modules)
    assert all(0.0 < seconds - gone_s <= HELD_S for seconds in left.values()), events_of(rig.rack)
    assert all(module.state is ModuleState.FAULT for module in rig.rack.modules.values())


@pytest.mark.parametrize("bus", [bus.name for bus in TOPOLOGY.buses])
def test_when_a_bus_goes_off_the_controller_stops_the_others_and_its_modules_hold_by_themselves(
    rig: FaultyRig, bus: str
) -> None:
    rig.sway(50)
    rig.buses[bus].go_off()
    off_s = rig.seconds
    state = rig.sway(20)
    assert state.status is DeviceStatus.FAULT and bus in state.fault
    left = rig.left_armed_s()
    assert len(left) == len(rig.topology.modules)
    assert all(0.0 <= seconds - off_s <= HELD_S for seconds in left.values()), events_of(rig.rack)
    _stands_still(rig)


def test_a_bus_that_comes_back_moves_nothing_until_it_is_armed_again(rig: FaultyRig) -> None:
    rig.sway(50)
    rig.buses["right_hand"].go_off()
    rig.sway(25)
    rig.buses["right_hand"].come_back()
    assert rig.sway(50).status is DeviceStatus.FAULT
    assert all(module.state is not ModuleState.ARMED for module in rig.rack.modules.values())
    _rearms_where_it_is(rig)


@pytest.mark.parametrize("name", ["right_thumb", "left_fore", "right_wrist"])
def test_a_module_that_reboots_stops_everything_and_is_armed_again_only_when_told(rig: FaultyRig, name: str) -> None:
    rig.sway(50)
    module = rig.rack.modules[_module(rig, name)]
    module.power_off()
    rig.sway(2)
    module.power_on(rig.clock.now_ns())
    began_s = rig.seconds
    state = rig.sway(20)
    assert state.status is DeviceStatus.FAULT and f"module {name}" in state.fault
    assert max(rig.left_armed_s().values()) - began_s <= HELD_S
    assert rig.sway(100).status is DeviceStatus.FAULT
    assert module.state is not ModuleState.ARMED
    _rearms_where_it_is(rig)


def test_a_new_controller_moves_nothing_until_told_and_then_begins_at_the_measured_position(rig: FaultyRig) -> None:
    rig.sway(50)
    for _ in range(200):
        rig.robot.step()
    gone = rig.can
    random = Random(99)
    rig.device = rig.can = CanDevice(rig.topology, rig.open_bus, None, lambda: random.getrandbits(32))
    rig.can.open()
    before = rig.wait(0.2)
    assert before.status is DeviceStatus.DISARMED
    assert not rig.write(before.position + 0.1)
    assert all(module.state is not ModuleState.ARMED for module in rig.rack.modules.values())
    _rearms_where_it_is(rig)
    gone.close()
    assert rig.wait(0.05).status is DeviceStatus.FAULT, "the quick stop of the other one must be obeyed"


@pytest.mark.parametrize(
    "faults",
    [
        FrameFaults(drop=0.01),
        FrameFaults(drop=0.05),
        FrameFaults(jitter_s=0.002),
        FrameFaults(corrupt=0.01),
        FrameFaults(duplicate=0.05),
        FrameFaults(reorder=0.05),
        FrameFaults(drop=0.01, duplicate=0.01, reorder=0.01, corrupt=0.01, jitter_s=0.001),
    ],
    ids=["loss1", "loss5", "jitter2", "corrupt1", "double5", "reorder5", "bad_wire"],
)
def test_a_bad_wire_costs_frames_and_never_breaks_a_rule(faults: FrameFaults) -> None:
    rig = FaultyRig(faults, seed=3)
    rig.device.open()
    rig.wait(0.02)
    rig.arm()
    rig.begin()
    state = rig.sway(500)
    assert state.status is DeviceStatus.ARMED, state.fault
    verdict = rig.verdict()
    assert verdict.ok, verdict.violations
    met = sum((bus.counts for bus in rig.buses.values()), start=type(rig.buses["arms"].counts)())
    assert all(met[name] > 0 for name in ("drop", "duplicate", "reorder", "corrupt") if getattr(faults, name))
    assert (verdict.damaged > 0) == (faults.corrupt > 0)
    reached = np.abs(state.position - rig.read().position)
    assert reached.max() < 0.1
    rig.close()


def test_the_same_seed_makes_the_same_frames_on_every_bus() -> None:
    verdicts = []
    for _ in range(2):
        rig = FaultyRig(FrameFaults(drop=0.05, jitter_s=0.001), seed=4)
        rig.ready()
        rig.begin()
        rig.sway(100)
        verdicts.append(
            (rig.verdict().frames, [bus.counts for bus in rig.buses.values()], rig.read().position.tobytes())
        )
        rig.close()
    assert verdicts[0] == verdicts[1]


def _stands_still(rig: FaultyRig) -> None:
    """Assert that nothing moves any more once it has come to rest."""
    rig.wait(0.1)
    before = rig.robot.position.copy()
    rig.wait(0.1)
    assert np.abs(rig.robot.position - before).max() < 0.01


def _rearms_where_it_is(rig: FaultyRig) -> None:
    """Arm and go on; the first command is what was measured, and the monitor holds every module to it."""
    rig.sequence = max(rig.sequence, 0)
    armed = rig.arm()
    assert rig.write(armed.position)
    state = rig.wait(0.02)
    assert np.abs(state.position - armed.position)[_hands()].max() < 0.01
    verdict = rig.verdict()
    assert verdict.ok, verdict.violations


def _hands() -> np.ndarray:
    return np.array(["arm" not in name for name in LAYOUT.names])
