"""An observer that looks now and then at what a device knows of its own parts."""

from __future__ import annotations

from preshape.hal.can.budget import bus_budget
from preshape.hal.can.bus_health import BusCondition
from preshape.hal.can.device import CanDevice
from preshape.hal.can.topology import BusSpec
from preshape.hal.can.wire import Wire
from preshape.hal.device import Device
from preshape.hal.tick_record import TickRecord
from preshape.tools.part_figures import PartFigures, PartsMemory, PartsWriter

INTERVAL_NS = 500_000_000
"""Time between two looks, on the loop's clock, ns."""


class PartsObserver:
    """An observer that looks at a device's parts twice a second; a device without any costs nothing."""

    def __init__(self, memory: PartsMemory, device: Device, rate_hz: float) -> None:
        """Look at a device whose loop has this rate."""
        self._writer = PartsWriter(memory)
        self._device = device if isinstance(device, CanDevice) else None
        self._rate_hz = rate_hz
        self._due_ns = self._before_ns = 0
        self._counts: dict[str, int] = {}

    def notify(self, record: TickRecord) -> None:
        """Look if it is time."""
        now_ns = int(record["now_ns"])
        if self._device is None or now_ns < self._due_ns:
            return
        self._due_ns = now_ns + INTERVAL_NS
        figures = self._figures(self._device, max(1, now_ns - self._before_ns) * 1e-9)
        self._before_ns = now_ns
        self._writer.write(figures)

    def _figures(self, device: CanDevice, since_s: float) -> list[PartFigures]:
        temperatures = device.temperatures_degc
        buses = {bus.name: bus for bus in device.topology.buses}
        return [
            self._bus(buses[name], wire, since_s, {m.name: temperatures.get(m.name) for m in buses[name].modules})
            for name, wire in device.wires.items()
        ]

    def _bus(
        self, bus: BusSpec, wire: Wire, since_s: float, temperatures: dict[str, int | None]
    ) -> PartFigures:  # fmt: skip
        count = wire.counts["received"] + wire.counts["sent"]
        rate_hz = (count - self._counts.get(bus.name, 0)) / since_s
        self._counts[bus.name] = count
        budget = bus_budget(bus, self._rate_hz)
        return PartFigures(
            name=bus.name,
            status=wire.health.condition.name,
            fault=wire.trouble or ("has been off" if wire.health.condition is BusCondition.OFF else ""),
            count=count,
            rate_hz=rate_hz,
            bus_load=budget.load * rate_hz / (budget.frames * self._rate_hz),
            bus_errors=sum(wire.health.counts.values()),
            temperature_c={name: float(value) for name, value in temperatures.items() if value is not None},
        )
