"""How long frames last at the worst, how much of a bus its cycle takes, and when the last answer comes. Pure.

Worst-case stuffing, 11-bit identifiers. Classic: 8 n + 47 + floor((34 + 8 n - 1) / 4) bits. ISO CAN FD: 34 bits at
the nominal rate, then d + floor(d / 4) + 4 + CRC + FSB bits at the data rate with d = 5 + 8 n, where CRC and fixed
stuff bits are 17 and 6 up to 16 bytes, 21 and 7 above.
"""

from __future__ import annotations

from dataclasses import dataclass

from preshape.hal.can.command_codec import CommandCodec
from preshape.hal.can.emergency_codec import EMERGENCY_LENGTH
from preshape.hal.can.heartbeat_codec import HEARTBEAT_LENGTH, HEARTBEAT_S
from preshape.hal.can.parameter_codec import PARAMETER_LENGTH
from preshape.hal.can.quick_stop_codec import QUICK_STOP_LENGTH
from preshape.hal.can.slices import CLASSIC_BYTES, slice_count
from preshape.hal.can.state_codec import StateCodec
from preshape.hal.can.topology import BusSpec, Topology

MOST_LOAD = 0.8
"""Share of a bus that its periodic frames may take at most."""


class BudgetExceeded(ValueError):
    """A bus cannot carry its frames at the rate; the message has the figure."""


def classic_bits(length: int) -> int:
    """Return the worst-case bits of a classic frame, interframe space included."""
    return 8 * length + 47 + (34 + 8 * length - 1) // 4


def classic_us(length: int, bit_per_s: float) -> float:
    """Return how long a classic frame lasts at the worst, us."""
    return classic_bits(length) / bit_per_s * 1e6


def fd_us(length: int, nominal_bit_per_s: float, data_bit_per_s: float) -> float:
    """Return how long a CAN FD frame with bit-rate switch lasts at the worst, us."""
    content = 5 + 8 * length
    checksum = 17 + 6 if length <= 16 else 21 + 7
    data = content + content // 4 + 4 + checksum
    return (34 / nominal_bit_per_s + data / data_bit_per_s) * 1e6


def payload_us(bus: BusSpec, length: int) -> float:
    """Return how long one payload lasts on a bus at the worst: one FD frame, or its slices in classic ones, us."""
    if bus.profile == "fd":
        return fd_us(length, bus.nominal_bit_per_s, bus.data_bit_per_s)
    return slice_count(length) * classic_us(min(length, CLASSIC_BYTES), bus.nominal_bit_per_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class BusBudget:
    """What one bus carries; times in us.

    Attributes:
        bus: its name.
        rate_hz: cycles per second.
        frames: frames of one cycle.
        cycle_us: all broadcasts and states of one cycle.
        load: share of the time that cycles and heartbeats take together.
        worst_us: a cycle into which everything else falls at once: a quick stop, every module's emergency and
            heartbeat, one parameter request and its reply.
        response_us: from the first broadcast handed over until the last state has arrived, at the worst: one frame
            of lower priority under way, then a quick stop and every emergency, then the cycle itself.
        most_hz: highest rate at which the load is allowed.
    """

    bus: str
    rate_hz: float
    frames: int
    cycle_us: float
    load: float
    worst_us: float
    response_us: float
    most_hz: float

    @property
    def fits(self) -> bool:
        """Whether the load is allowed."""
        return self.load <= MOST_LOAD


def bus_budget(bus: BusSpec, rate_hz: float) -> BusBudget:
    """Return what a bus carries at a rate."""
    lengths = [CommandCodec(group).length for group in bus.groups]
    lengths += [StateCodec(module, group).length for group in bus.groups for module in group.modules]
    cycle_us = sum(payload_us(bus, length) for length in lengths)
    nodes = len(bus.modules)
    beats_us = nodes * payload_us(bus, HEARTBEAT_LENGTH)
    beat_load = beats_us * 1e-6 / HEARTBEAT_S
    urgent_us = payload_us(bus, QUICK_STOP_LENGTH) + nodes * payload_us(bus, EMERGENCY_LENGTH)
    exchange_us = 2 * payload_us(bus, PARAMETER_LENGTH)
    under_way_us = (
        max(payload_us(bus, PARAMETER_LENGTH), payload_us(bus, HEARTBEAT_LENGTH))
        if bus.profile == "fd"
        else classic_us(CLASSIC_BYTES, bus.nominal_bit_per_s)
    )
    return BusBudget(
        bus=bus.name,
        rate_hz=rate_hz,
        frames=len(lengths) if bus.profile == "fd" else sum(slice_count(length) for length in lengths),
        cycle_us=cycle_us,
        load=cycle_us * 1e-6 * rate_hz + beat_load,
        worst_us=cycle_us + urgent_us + beats_us + exchange_us,
        response_us=under_way_us + urgent_us + cycle_us,
        most_hz=(MOST_LOAD - beat_load) / (cycle_us * 1e-6),
    )


def budgets(topology: Topology, rate_hz: float) -> tuple[BusBudget, ...]:
    """Return what each bus carries at a rate, whether it fits or not."""
    return tuple(bus_budget(bus, rate_hz) for bus in topology.buses)


def require_fit(topology: Topology, rate_hz: float) -> None:
    """Refuse a rate that a bus cannot carry; `BudgetExceeded` names bus, load and the highest rate that fits."""
    for budget in budgets(topology, rate_hz):
        if not budget.fits:
            raise BudgetExceeded(
                f"rate of bus {budget.bus}: got {rate_hz:g} Hz, which takes {budget.load:.0%} of it, "
                f"allowed is {MOST_LOAD:.0%} ({budget.most_hz:.0f} Hz)"
            )
