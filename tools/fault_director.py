"""Lets the events of a fault plan happen when their time has come: at a time of the run, or of one of its tasks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Protocol

from preshape.hal.can.topology import Topology
from preshape.hal.tick_record import TickRecord
from preshape.sim_backend.fault_plan import FaultEvent, FaultKind, FaultPlan
from preshape.sim_backend.faulty_bus import FaultyBus
from preshape.sim_backend.stalling_clock import StallingClock
from preshape.sim_backend.torque_fault import TorqueFault


class Powered(Protocol):
    """A module whose power can be cut."""

    def power_off(self) -> None:
        """Go dark."""
        ...

    def power_on(self, now_ns: int) -> None:
        """Start anew."""
        ...


class FaultDirector:
    """Watches the loop (`preshape.control.observer.Observer`) for the time and the task; acts on buses and modules.

    `happened` lists what began and ended: seconds since the first tick, and what.
    """

    def __init__(
        self,
        plan: FaultPlan,
        topology: Topology,
        buses: Mapping[str, FaultyBus],
        modules: Mapping[int, Powered],
        clock: StallingClock,
    ) -> None:
        """Take over buses by name, modules by node, and the loop's clock.

        Raises:
            ValueError: torques cannot be changed on a bus of the classic profile: no frame holds a whole state.
        """
        self._topology, self._buses, self._modules, self._clock = topology, buses, modules, clock
        self._waiting = list(plan.events)
        self._ending: list[tuple[int, FaultEvent]] = []
        self._began_ns: dict[int, int] = {}
        self._now_ns = 0
        self.happened: list[tuple[float, str]] = []
        for event in plan.events:
            if event.kind in (FaultKind.TORQUE_FREEZE, FaultKind.TORQUE_DRIFT) and self._is_classic(event.target):
                raise ValueError(f"{event.kind.value} of {event.target}: got a classic bus, allowed is CAN FD")

    def notify(self, record: TickRecord) -> None:
        """Let happen what is due in this tick."""
        self._now_ns = int(record["now_ns"])
        self._began_ns.setdefault(0, self._now_ns)
        self._began_ns.setdefault(int(record["task"]), self._now_ns)
        for due_ns, event in tuple(self._ending):
            if due_ns <= self._now_ns:
                self._ending.remove((due_ns, event))
                self._end(event)
        for event in tuple(self._waiting):
            began_ns = self._began_ns.get(event.task)
            if began_ns is not None and self._now_ns >= began_ns + round(event.after_s * 1e9):
                self._waiting.remove(event)
                self._begin(event)

    def _begin(self, event: FaultEvent) -> None:
        self._note(event, "begins")
        actions: Mapping[FaultKind, Callable[[FaultEvent], None]] = {
            FaultKind.BUS_OFF: lambda event: self._buses[event.target].go_off(),
            FaultKind.NODE_DEATH: lambda event: self._modules[self._node(event.target)].power_off(),
            FaultKind.TORQUE_FREEZE: self._change_torque,
            FaultKind.TORQUE_DRIFT: self._change_torque,
            FaultKind.HOST_STALL: lambda event: self._clock.stall(event.lasts_s),
        }
        actions[event.kind](event)
        if math.isfinite(event.lasts_s) and event.kind is not FaultKind.HOST_STALL:
            self._ending.append((self._now_ns + round(event.lasts_s * 1e9), event))

    def _end(self, event: FaultEvent) -> None:
        self._note(event, "ends")
        match event.kind:
            case FaultKind.BUS_OFF:
                self._buses[event.target].come_back()
            case FaultKind.NODE_DEATH:
                self._modules[self._node(event.target)].power_on(self._clock.now_ns())
            case FaultKind.TORQUE_FREEZE | FaultKind.TORQUE_DRIFT:
                self._buses[self._bus_of(event.target)].rewrite.pop(self._node(event.target), None)
            case FaultKind.HOST_STALL:
                pass

    def _change_torque(self, event: FaultEvent) -> None:
        module = next(module for module in self._topology.modules if module.name == event.target)
        rate = event.rate if event.kind is FaultKind.TORQUE_DRIFT else None
        fault = TorqueFault(module, self._topology.group_of(module), rate, self._clock.now_ns)
        self._buses[self._bus_of(event.target)].rewrite[module.node] = fault

    def _note(self, event: FaultEvent, what: str) -> None:
        target = f" of {event.target}" if event.target else ""
        self.happened.append(((self._now_ns - self._began_ns[0]) * 1e-9, f"{event.kind.value}{target} {what}"))

    def _node(self, name: str) -> int:
        return next(module.node for module in self._topology.modules if module.name == name)

    def _bus_of(self, name: str) -> str:
        return next(bus.name for bus in self._topology.buses if name in (module.name for module in bus.modules))

    def _is_classic(self, name: str) -> bool:
        return any(bus.profile == "classic" for bus in self._topology.buses if bus.name == self._bus_of(name))
