"""Events of a fault plan happen at their times, on the right bus and module, and end when they are to end."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import can
import numpy as np
import pytest
from manual_clock import ManualClock

from preshape.hal.can.state_codec import ModuleReport, StateCodec
from preshape.hal.can.topology import TOPOLOGY, Module, robot_topology
from preshape.hal.can.vocabulary import ModuleError, ModuleState
from preshape.hal.tick_record import new_record
from preshape.sim_backend.fault_plan import FrameFaults
from preshape.sim_backend.faulty_bus import FaultyBus
from preshape.sim_backend.stalling_clock import StallingClock
from preshape.tools.fault_director import FaultDirector
from preshape.tools.fault_text import parse_faults

CHANNELS = itertools.count()
TICK_NS = 2_000_000
FORE = next(module for module in TOPOLOGY.modules if module.name == "right_fore")


class _Module:
    """Remembers when its power went and came."""

    def __init__(self) -> None:
        self.powered = True
        self.started_ns: list[int] = []

    def power_off(self) -> None:
        self.powered = False

    def power_on(self, now_ns: int) -> None:
        self.powered = True
        self.started_ns.append(now_ns)


class Stage:
    """Buses, modules and a clock for a plan; `tick` lets the loop's ticks pass."""

    def __init__(self, text: str) -> None:
        self.clock = StallingClock(ManualClock())
        self.hosts: dict[str, can.BusABC] = {}
        self.buses: dict[str, FaultyBus] = {}
        for bus in TOPOLOGY.buses:
            channel = f"director-{next(CHANNELS)}"
            self.hosts[bus.name] = can.Bus(channel, interface="virtual")
            ours = can.Bus(channel, interface="virtual")
            self.buses[bus.name] = FaultyBus(ours, "modules", FrameFaults(), 0, self.clock.now_ns)
        self.modules = {module.node: _Module() for module in TOPOLOGY.modules}
        self.director = FaultDirector(parse_faults(text), TOPOLOGY, self.buses, self.modules, self.clock)
        self.began_ns = self.clock.now_ns()

    def tick(self, task: int, count: int = 1) -> None:
        for _ in range(count):
            record = new_record()
            record["now_ns"], record["task"] = self.clock.now_ns(), task
            self.director.notify(record)
            self.clock.sleep_until_ns(self.clock.now_ns() + TICK_NS)

    @property
    def seconds(self) -> float:
        return (self.clock.now_ns() - self.began_ns) * 1e-9

    def close(self) -> None:
        for bus in (*self.hosts.values(), *self.buses.values()):
            bus.shutdown()


@pytest.fixture
def stage(request: pytest.FixtureRequest) -> Iterator[Stage]:
    stage = Stage(request.param)
    yield stage
    stage.close()


def _report(module: Module, torque: float) -> bytes:
    values = np.full(len(module.joints), torque)
    report = ModuleReport(7, ModuleState.ARMED, ModuleError.NONE, True, 30, values, values, values)
    return bytes(StateCodec(module, TOPOLOGY.group_of(module)).encode(report))


def _reported(stage: Stage, torque: float) -> tuple[float, float]:
    """Send a state through the right hand's bus; return the position and the torque that arrive."""
    codec = StateCodec(FORE, TOPOLOGY.group_of(FORE))
    message = can.Message(arbitration_id=codec.frame_id, data=_report(FORE, torque), is_extended_id=False, is_fd=True)
    stage.buses["right_hand"].send(message)
    got = stage.hosts["right_hand"].recv(0.0)
    assert got is not None
    report = codec.decode(bytes(got.data))
    assert report is not None and (report.sequence, report.temperature_degc) == (7, 30)
    return float(report.position[0]), float(report.torque[0])


@pytest.mark.parametrize("stage", ["node_death=right_fore@task3+0.1"], indirect=True)
def test_an_event_of_a_task_waits_for_that_task(stage: Stage) -> None:
    stage.tick(1, 100)
    stage.tick(2, 100)
    stage.tick(3, 50)
    assert all(module.powered for module in stage.modules.values())
    stage.tick(3)
    assert [node for node, module in stage.modules.items() if not module.powered] == [FORE.node]
    assert stage.director.happened == [(pytest.approx(0.5), "node_death of right_fore begins")]


@pytest.mark.parametrize("stage", ["node_reboot=left_thumb@0.1/0.05"], indirect=True)
def test_a_module_that_reboots_comes_back_after_its_time(stage: Stage) -> None:
    node = next(module.node for module in TOPOLOGY.modules if module.name == "left_thumb")
    stage.tick(1, 51)
    assert not stage.modules[node].powered
    stage.tick(1, 25)
    assert stage.modules[node].powered
    assert stage.modules[node].started_ns == [stage.began_ns + 150_000_000]
    assert [what for _, what in stage.director.happened] == [
        "node_death of left_thumb begins",
        "node_death of left_thumb ends",
    ]


@pytest.mark.parametrize("stage", ["bus_off=left_hand@task2/0.02"], indirect=True)
def test_a_bus_goes_off_and_comes_back_alone(stage: Stage) -> None:
    stage.tick(1)
    assert not any(bus.off for bus in stage.buses.values())
    stage.tick(2)
    assert [name for name, bus in stage.buses.items() if bus.off] == ["left_hand"]
    stage.tick(2, 10)
    assert not any(bus.off for bus in stage.buses.values())


@pytest.mark.parametrize("stage", ["torque_freeze=right_fore@0.01/0.05"], indirect=True)
def test_a_frozen_sensor_repeats_its_torque_and_still_reports_its_position(stage: Stage) -> None:
    stage.tick(1, 3)
    assert _reported(stage, 0.1) == pytest.approx((0.1, 0.1))
    stage.tick(1, 5)
    assert _reported(stage, 0.2) == pytest.approx((0.2, 0.2))
    assert _reported(stage, 0.3) == pytest.approx((0.3, 0.2))
    stage.tick(1, 30)
    assert _reported(stage, 0.4) == pytest.approx((0.4, 0.4))


@pytest.mark.parametrize("stage", ["torque_drift=right_fore:0.5@0"], indirect=True)
def test_a_drifting_sensor_is_off_by_rate_times_time(stage: Stage) -> None:
    stage.tick(1, 100)
    position, torque = _reported(stage, 0.1)
    assert (position, torque) == pytest.approx((0.1, 0.1 + 0.5 * stage.seconds), abs=2e-4)


@pytest.mark.parametrize("stage", ["host_stall_ms=30@0.1"], indirect=True)
def test_a_stalled_host_sleeps_once_for_so_much_longer(stage: Stage) -> None:
    stage.tick(1, 50)
    assert stage.seconds == pytest.approx(0.1)
    stage.tick(1)
    assert stage.seconds == pytest.approx(0.132)
    stage.tick(1)
    assert stage.seconds == pytest.approx(0.134)


def test_torques_cannot_be_changed_on_a_classic_bus() -> None:
    topology = robot_topology("classic")
    plan = parse_faults("torque_freeze=right_fore@1", topology)
    with pytest.raises(ValueError, match="torque_freeze of right_fore: got a classic bus, allowed is CAN FD"):
        FaultDirector(plan, topology, {}, {}, StallingClock(ManualClock()))
