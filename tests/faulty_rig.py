"""A driver and modules on buses on which things go wrong, with the passive monitor listening on all of them."""

from __future__ import annotations

import can
import numpy as np
from can_rig import CanRig

from preshape.hal.can.topology import BusSpec
from preshape.hal.can.vocabulary import ModuleState
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, RobotState
from preshape.sim_backend.fault_plan import FrameFaults
from preshape.sim_backend.faulty_bus import FaultyBus
from preshape.sim_backend.module_rack import ModuleRack
from preshape.tools.wire_monitor import WireMonitor, WireVerdict


class FaultyRig(CanRig):
    """The modules' ends of all buses meet faults; `monitor` hears everything, in simulated time."""

    def __init__(self, faults: FrameFaults | None = None, seed: int = 0) -> None:
        self.faults, self.seed = faults or FrameFaults(), seed
        self.buses: dict[str, FaultyBus] = {}
        super().__init__(seed=seed)
        self.monitor = WireMonitor(self.period_s)
        self._taps = {spec.name: self.tap(spec.name) for spec in self.topology.buses}
        self.robot.before_step.append(self._listen)
        self.robot.after_step.append(self._listen)

    def module_bus(self, spec: BusSpec) -> can.BusABC:
        seed = 1000 * self.seed + len(self.buses)
        bus = FaultyBus(super().module_bus(spec), "modules", self.faults, seed, lambda: self.robot.time_ns)
        self.buses[spec.name] = bus
        return bus

    def sway(self, cycles: int) -> RobotState:
        """Let the fingers sway by commands, as long as they are taken; return the last state."""
        state = self.read()
        for _ in range(cycles):
            if state.status is DeviceStatus.ARMED:
                self.write(self._start + 0.1 * (1.0 - np.cos(6.0 * (self.seconds - self._began_s))) * _HANDS)
            state = self.wait(self.period_s)
        return state

    def begin(self) -> None:
        """Sway from here."""
        self._start, self._began_s = self.read().position, self.seconds

    @property
    def seconds(self) -> float:
        """Simulated time, s."""
        return self.clock.now_ns() * 1e-9

    def left_armed_s(self) -> dict[str, float]:
        """Return when each module left ARMED for the last time, in its own time, s."""
        names = {module.node: module.name for module in self.topology.modules}
        events = {event.node: event for event in self.rack.events}
        return {names[n]: event.time_ns * 1e-9 for n, event in events.items() if event.state is not ModuleState.ARMED}

    def verdict(self) -> WireVerdict:
        """Return what the monitor has heard so far."""
        self._listen(0)
        return self.monitor.verdict()

    def _listen(self, time_ns: int) -> None:
        for name, tap in self._taps.items():
            while (frame := tap.recv(0.0)) is not None:
                data = bytes(frame.data)
                self.monitor.take(self.seconds, frame.arbitration_id, data, name, frame.is_error_frame)

    def close(self) -> None:
        super().close()
        for tap in self._taps.values():
            tap.shutdown()


_HANDS = np.array(["arm" not in name and ("flex" in name or "pip" in name) for name in LAYOUT.names], dtype=float)
"""1 for the joints that sway: the fingers' flexions; 0 for the others."""


def events_of(rack: ModuleRack) -> list[str]:
    """Return every change of state as text."""
    return [f"{event.time_ns * 1e-9:.4f} {event.node} {event.state.name} {event.cause}" for event in rack.events]
