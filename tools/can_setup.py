"""The hand bus as the options ask for it: topology, addresses and patience, checked before anything is opened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from preshape.hal.can.budget import BudgetExceeded, require_fit
from preshape.hal.can.bus_address import BusAddress, bus_addresses
from preshape.hal.can.device_config import CanDeviceConfig
from preshape.hal.can.topology import Profile, Topology, robot_topology
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.run_options import RunOptions


@dataclass(frozen=True, slots=True, eq=False)
class CanSetup:
    """What is on which bus, where each bus is, and how patient the driver is."""

    topology: Topology
    addresses: Mapping[str, BusAddress]
    config: CanDeviceConfig


def hand_bus(profile: Profile, interface: str, channels: Sequence[str]) -> tuple[Topology, dict[str, BusAddress]]:
    """Return topology and addresses; all groups share one bus where one socketcan channel is given for all.

    Raises:
        ConfigurationError: the number of channels does not suit.
    """
    topology = robot_topology(profile)
    if interface == "socketcan" and len(channels) == 1:
        topology = topology.on_one_bus()
    try:
        return topology, bus_addresses(topology, interface, channels)
    except ValueError as error:
        raise ConfigurationError(f"--channel: {error}") from error


def can_setup(options: RunOptions) -> CanSetup:
    """Return the hand bus of a run.

    Raises:
        ConfigurationError: the channels do not suit, or a bus cannot carry its frames at the rate.
    """
    interface = options.interface or ("udp_multicast" if options.in_real_time else "virtual")
    topology, addresses = hand_bus(options.profile, interface, options.channel)
    try:
        require_fit(topology, options.loop_rate_hz)
    except BudgetExceeded as error:
        raise ConfigurationError(f"--rate-hz: {error}") from error
    return CanSetup(
        topology, addresses, CanDeviceConfig(period_s=1.0 / options.loop_rate_hz, lost_cycles=options.patience)
    )
