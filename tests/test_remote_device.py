"""The laws of devices over Zenoh: served by another process, killed and stopped on both sides."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from typing import ClassVar

import numpy as np
import pytest
import zenoh
from device_conformance import DeviceConformance, Rig
from fuzz_device import fuzz_device
from remote_client import drive_until_killed
from served_device import ROOT, Served, served
from zenoh_robot import until

from preshape.hal.clock import MonotonicClock
from preshape.hal.device import DeviceUnreachable
from preshape.hal.gate import SafetyGate
from preshape.hal.gate_config import GateConfig
from preshape.hal.layout import LAYOUT
from preshape.hal.remote_device import RemoteDevice
from preshape.hal.remote_line import RemoteLine
from preshape.hal.state import DeviceStatus
from preshape.sim_backend.simulation import home_position
from preshape.tools.zenoh_session import client_settings, open_session

pytestmark = pytest.mark.physics


class TestRemoteDevice(DeviceConformance):
    """MuJoCo in another process; one server serves all laws."""

    readable_when_closed = True
    freshest_s = 0.2
    server: ClassVar[Served]
    session: ClassVar[zenoh.Session]

    @pytest.fixture(autouse=True, scope="class")
    @classmethod
    def one_server(cls) -> Iterator[None]:
        with served() as server, server.session() as session:
            cls.server, cls.session = server, session
            yield

    def open_rig(self) -> Rig:
        line = RemoteLine(self.session, ROOT)
        rig = Rig(RemoteDevice(line), MonotonicClock())
        rig.device.open()
        rig.arm()
        rig.drive(home_position(), 0.3)
        rig.device.close()
        return Rig(RemoteDevice(line), MonotonicClock())


@pytest.fixture
def server() -> Iterator[Served]:
    with served() as running:
        yield running


def opened(session: zenoh.Session) -> RemoteDevice:
    device = RemoteDevice(RemoteLine(session, ROOT))
    device.open()
    return device


def now() -> int:
    return time.monotonic_ns()


def test_a_killed_client_leaves_the_joints_stopped_and_free_for_the_next(server: Served) -> None:
    context = multiprocessing.get_context("spawn")
    client = context.Process(target=drive_until_killed, args=(server.endpoint,), daemon=True)
    client.start()
    with server.session() as session:
        watcher = RemoteDevice(RemoteLine(session, ROOT))
        moving = until(lambda: np.abs(watcher.read(now()).velocity).max() > 0.05, 30.0)
        assert moving and watcher.read(now()).status is DeviceStatus.ARMED
        with pytest.raises(DeviceUnreachable, match="open for another client"):
            watcher.open()
        assert client.pid is not None
        os.kill(client.pid, signal.SIGKILL)
        client.join()
        # Either the module's own watchdog or the server's look at its client comes first; both hold, latched.
        assert until(lambda: watcher.read(now()).status in (DeviceStatus.STOPPED, DeviceStatus.FAULT))
        assert until(lambda: np.abs(watcher.read(now()).velocity).max() < 0.05)
        stopped = watcher.read(now())
        assert (np.abs(stopped.torque) <= 1.2 * LAYOUT.torque).all()
        assert until(lambda: watcher.read(now()).status is DeviceStatus.STOPPED)
        assert watcher.read(now()).fault == "the client has gone"
        rig = Rig(watcher, MonotonicClock())
        watcher.open()
        assert rig.wait(0.05).status is DeviceStatus.DISARMED
        assert np.abs(rig.arm().position - stopped.position).max() < 0.05


def test_a_killed_server_is_a_fault_with_a_name_and_stops_the_gate(server: Served) -> None:
    with server.session() as session:
        # The loss alone is to stop it, however slow this machine is.
        device, gate = opened(session), SafetyGate(GateConfig(watchdog_s=10.0, stop_age_s=10.0))
        Rig(device, MonotonicClock()).arm()
        assert gate.arm(now(), device.read(now()))
        server.signal(signal.SIGKILL)
        assert until(lambda: device.read(now()).status is DeviceStatus.FAULT)
        gate.check(now(), device.read(now()))
        assert not gate.armed and "has gone" in gate.reason
        assert not Rig(device, MonotonicClock()).write(device.read(now()).position)
        device.stop("test", now())
        device.close()
        with pytest.raises(DeviceUnreachable, match="has gone"):
            device.open()


def test_a_stopped_server_stops_the_gate_by_the_age_of_its_states(server: Served) -> None:
    with server.session() as session:
        device, gate = opened(session), SafetyGate(GateConfig(watchdog_s=10.0))
        Rig(device, MonotonicClock()).arm()
        assert gate.arm(now(), device.read(now()))
        server.signal(signal.SIGSTOP)
        deadline = time.monotonic() + 2.0
        while gate.armed and time.monotonic() < deadline:
            gate.check(now(), device.read(now()))
            time.sleep(0.002)
        server.signal(signal.SIGCONT)
        assert not gate.armed and gate.reason.startswith("stale state: ")


def test_what_is_told_first_is_done_first(server: Served) -> None:
    with server.session() as session:
        line = RemoteLine(session, ROOT)
        epoch = line.ask("open").epoch
        for _ in range(100):
            # Each of the two begins a new epoch.
            line.tell("stop", "a test")
            epoch, before = line.ask("open").epoch, epoch
            assert epoch == before + 2
        line.close()


def test_a_call_that_does_not_exist_is_refused_by_its_name(server: Served) -> None:
    with server.session() as session:
        line = RemoteLine(session, ROOT)
        with pytest.raises(RuntimeError, match="dance: no such call, allowed are open, arm, stop"):
            line.ask("dance")
        line.close()


def test_under_fuzzed_payloads_an_armed_device_stays_where_it_is_and_strangers_are_refused(server: Served) -> None:
    counts = fuzz_device(server, 2000, seed=3)
    assert counts["refused"] == counts["asked"] == 500


def test_what_all_can_see_of_a_client_does_not_tell_its_number(server: Served) -> None:
    with server.session() as session, server.session() as stranger:
        line = RemoteLine(session, ROOT)
        RemoteDevice(line).open()
        seen = [str(reply.ok.key_expr) for reply in stranger.liveliness().get("preshape/**") if reply.ok]
        assert any(key.startswith(f"{ROOT}/client/") for key in seen)
        assert not any(str(line.client) in key for key in seen)


def test_a_lost_state_is_counted(server: Served) -> None:
    with server.session() as session:
        line = RemoteLine(session, ROOT)
        device = RemoteDevice(line)
        device.open()
        assert until(lambda: device.read(now()) is not None and line.received["state"] > 50)
        before = device.lost
        line.received["state"] -= 3
        assert until(lambda: device.read(now()) is not None and device.lost >= before + 2)


def test_nobody_serving_is_said_in_one_line_with_what_to_do() -> None:
    with pytest.raises(DeviceUnreachable, match="Zenoh session at tcp/127.0.0.1:1: .*; start .*preshape serve") as told:
        open_session(client_settings("tcp/127.0.0.1:1"))
    assert "\n" not in str(told.value) and ".rs" not in str(told.value)
