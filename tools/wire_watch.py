"""What listens to the buses of a run, and what goes wrong on them: the passive monitor and the fault injector."""

from __future__ import annotations

from collections import Counter

import can

from preshape.hal.can.topology import Topology
from preshape.hal.clock import Clock
from preshape.hal.tick_record import TickRecord
from preshape.sim_backend.faulty_bus import FaultyBus
from preshape.sim_backend.module_rack import ModuleRack
from preshape.sim_backend.stalling_clock import StallingClock
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.fault_director import FaultDirector
from preshape.tools.fault_text import parse_faults
from preshape.tools.report import FaultReport, WireReport
from preshape.tools.wire_monitor import WireMonitor, WireVerdict
from preshape.tools.wire_rules import STOP_CYCLES

BUSES_A_SEED = 16
"""Seeds of a run's buses are this far apart from the next run's."""


class WireWatch:
    """Goes between a run and its world: wraps the modules' ends of the buses, hears every frame, watches the loop.

    Without faults the buses and the clock stay as they are. Frames of classic buses come in slices, which the monitor
    does not judge.
    """

    def __init__(
        self, faults: str, topology: Topology, period_s: float, seed: int, patience_cycles: int = STOP_CYCLES
    ) -> None:
        """Plan a run's faults, drawn by its seed; commands come every `period_s`, modules stop after so many without.

        Raises:
            ConfigurationError: the text is not one of faults.
        """
        self._faults, self._topology, self._seed = faults, topology, seed
        self._plan = parse_faults(faults, topology)
        self._monitor = WireMonitor(period_s, patience_cycles=patience_cycles)
        self._judged = all(bus.profile == "fd" for bus in topology.buses)
        self._buses: dict[str, FaultyBus] = {}
        self._director: FaultDirector | None = None

    def wrap(self, bus: can.BusABC, name: str, clock: Clock) -> can.BusABC:
        """Return the modules' end of a bus, with what goes wrong there (`preshape.sim_backend.can_lockstep.Wrap`)."""
        if not self._plan.any:
            return bus
        seed = self._seed * BUSES_A_SEED + len(self._buses)
        self._buses[name] = FaultyBus(bus, "modules", self._plan.frames, seed, clock.now_ns)
        return self._buses[name]

    def hear(self, frame: can.Message) -> None:
        """Judge one frame (`preshape.sim_backend.bus_log.Listener`)."""
        if self._judged:
            self._monitor.take(
                frame.timestamp, frame.arbitration_id, bytes(frame.data), frame.channel, frame.is_error_frame
            )

    def over(self, clock: Clock, rack: ModuleRack) -> Clock:
        """Return the clock that the loop is to go by, and get ready for the events planned.

        Raises:
            ConfigurationError: an event cannot happen on buses of this profile.
        """
        if not self._plan.events:
            return clock
        stalling = StallingClock(clock)
        try:
            self._director = FaultDirector(self._plan, self._topology, self._buses, rack.modules, stalling)
        except ValueError as error:
            raise ConfigurationError(f"--faults: {error}") from None
        return stalling

    def notify(self, record: TickRecord) -> None:
        """Let happen what is due (`preshape.control.observer.Observer`)."""
        if self._director is not None:
            self._director.notify(record)

    def report(self) -> WireReport | None:
        """Return what was on the wire, and what was made to go wrong; None where nobody could judge it."""
        if not self._judged:
            return None
        injected: Counter[str] = Counter()
        for bus in self._buses.values():
            injected.update({name: int(count) for name, count in bus.counts.items()})
        happened = [] if self._director is None else self._director.happened
        faults = FaultReport(faults=self._faults, injected=dict(injected), happened=list(happened))
        return wire_report(self._monitor.verdict(), faults if self._plan.any else None)


def wire_report(verdict: WireVerdict, faults: FaultReport | None) -> WireReport:
    """Return a verdict as a part of the report."""
    return WireReport(
        ok=verdict.ok,
        broken=dict(verdict.broken),
        violations=[str(violation) for violation in verdict.violations],
        frames=dict(verdict.frames),
        damaged=verdict.damaged,
        unknown={f"{frame_id:#05x}": count for frame_id, count in verdict.unknown.items()},
        errors=verdict.errors,
        torque_limit_ratio=verdict.torque_limit_ratio,
        speed_ratio=verdict.speed_ratio,
        torque_ratio=verdict.torque_ratio,
        faults=faults,
    )
