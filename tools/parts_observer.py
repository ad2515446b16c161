"""An observer that looks now and then at what a device knows of its own parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from preshape.hal.can.budget import bus_budget
from preshape.hal.can.bus_health import BusCondition
from preshape.hal.can.device import CanDevice
from preshape.hal.can.wire import Wire
from preshape.hal.device import Device
from preshape.hal.tick_record import TickRecord
from preshape.tools.part_figures import PartFigures, PartsMemory, PartsWriter

INTERVAL_NS = 500_000_000
"""Time between two looks, on the loop's clock, ns."""


class PartsObserver:
    """An observer that looks at a device's parts twice a second; a device without any costs nothing."""

    def __init__(self, memories: Sequence[PartsMemory], device: Device, rate_hz: float) -> None:
        """Look at a device whose loop has this rate, once for all who are told."""
        self._writers = [PartsWriter(memory) for memory in memories]
        self._device = device if isinstance(device, CanDevice) else None
        self._rate_hz = rate_hz
        buses = () if self._device is None else self._device.topology.buses
        self._buses = {bus.name: (bus, bus_budget(bus, rate_hz)) for bus in buses}
        self._due_ns = 0
        self._before_ns: int | None = None
        self._counts: dict[str, int] = {}

    def notify(self, record: TickRecord) -> None:
        """Look if it is time."""
        now_ns = int(record["now_ns"])
        if self._device is None or now_ns < self._due_ns:
            return
        self._due_ns = now_ns + INTERVAL_NS
        counts = {name: wire.counts["received"] + wire.counts["sent"] for name, wire in self._device.wires.items()}
        # A rate is over the time between two looks: the first one has none.
        if self._before_ns is not None:
            since_s, temperatures = (now_ns - self._before_ns) * 1e-9, self._device.temperatures_degc
            rates_hz = {name: (count - self._counts.get(name, 0)) / since_s for name, count in counts.items()}
            figures = [
                self._bus(name, wire, now_ns, counts[name], rates_hz[name], temperatures)
                for name, wire in self._device.wires.items()
            ]
            for writer in self._writers:
                writer.write(figures)
        self._before_ns, self._counts = now_ns, counts

    def _bus(
        self, name: str, wire: Wire, now_ns: int, count: int, rate_hz: float, temperatures: Mapping[str, int]
    ) -> PartFigures:
        bus, budget = self._buses[name]
        known = {module.name: temperatures.get(module.name) for module in bus.modules}
        return PartFigures(
            mono_ns=now_ns,
            name=bus.name,
            status=wire.health.condition.name,
            fault=wire.trouble or ("has been off" if wire.health.condition is BusCondition.OFF else ""),
            count=count,
            rate_hz=rate_hz,
            bus_load=budget.load * rate_hz / (budget.frames * self._rate_hz),
            bus_errors=sum(wire.health.counts.values()),
            temperature_c={name: float(value) for name, value in known.items() if value is not None},
        )
