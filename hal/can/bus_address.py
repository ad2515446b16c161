"""Where a bus is, and how it is opened: every way in which that fails becomes one line that says what to do."""

from __future__ import annotations

import errno
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import can

from preshape.hal.can.topology import Profile, Topology
from preshape.hal.device import DeviceUnreachable

InterfaceName = Literal["virtual", "socketcan", "udp_multicast"]
INTERFACES: tuple[str, ...] = get_args(InterfaceName)

MULTICAST_GROUP, MULTICAST_PORT = "239.74.163.2", 43113
"""Where `udp_multicast` buses are by default; the k-th bus takes the k-th port from there."""
LOCAL_HOPS = 0
"""Time to live of a multicast frame: motor commands stay on this machine."""
SEND_BUFFER_BYTES = 32_768
"""Frames that a socket may have queued in the kernel, in its own accounting: a few cycles, never hundreds."""

_DEFAULT_CHANNELS = {"virtual": "preshape", "socketcan": "can0", "udp_multicast": MULTICAST_GROUP}


@dataclass(frozen=True, slots=True)
class BusAddress:
    """One bus of this machine: python-can's interface name, and the channel in that interface's way of writing it."""

    interface: str
    channel: str

    def __str__(self) -> str:
        return f"{self.interface} {self.channel}"

    @property
    def echoes(self) -> bool:
        """Whether who sends a frame receives it as well, as members of a multicast group do."""
        return self.interface == "udp_multicast"


def bus_addresses(topology: Topology, interface: str, channels: Sequence[str] = ()) -> dict[str, BusAddress]:
    """Return each bus's address by its name.

    `channels`: one for each bus, or for a virtual or a multicast bus one alone, from which the others are numbered.

    Raises:
        ValueError: the number of channels does not suit.
    """
    names = [bus.name for bus in topology.buses]
    if not channels and interface == "socketcan":
        channels = [f"can{number}" for number in range(len(names))]
    if len(channels) <= 1 and (len(names) == 1 or interface != "socketcan"):
        base = channels[0] if channels else _DEFAULT_CHANNELS.get(interface, "0")
        channels = [_numbered(interface, base, number) for number in range(len(names))]
    if len(channels) != len(names):
        raise ValueError(f"channels: got {len(channels)}, allowed are {len(names)}, for {', '.join(names)}")
    return {name: BusAddress(interface, channel) for name, channel in zip(names, channels, strict=True)}


def _numbered(interface: str, base: str, number: int) -> str:
    if interface == "udp_multicast":
        group, _, port = base.partition(":")
        if port and not (port.isdecimal() and 0 < int(port) < 65536):
            raise ValueError(f"channel {base}: got port {port!r}, allowed is 1 .. 65535")
        return f"{group}:{int(port or MULTICAST_PORT) + number}"
    return base if number == 0 else f"{base}.{number}"


def open_bus(address: BusAddress, profile: Profile, identifiers: Sequence[int] = ()) -> can.BusABC:
    """Open a bus; where the kernel filters, only frames of the given identifiers come (all, if none are given).

    Raises:
        DeviceUnreachable: in one line, with what to do.
    """
    try:
        return _open(address, profile, identifiers)
    except (can.CanError, OSError, ValueError, ImportError) as error:
        raise DeviceUnreachable(f"bus {address}: {_advice(address, error)}") from error


def _open(address: BusAddress, profile: Profile, identifiers: Sequence[int]) -> can.BusABC:
    fd = profile == "fd"
    match address.interface:
        case "virtual":
            protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
            return can.Bus(interface="virtual", channel=address.channel, protocol=protocol)
        case "udp_multicast":
            group, _, port = address.channel.partition(":")
            number = int(port or MULTICAST_PORT)
            return can.Bus(interface="udp_multicast", channel=group, port=number, hop_limit=LOCAL_HOPS, fd=fd)
        case "socketcan":
            return _open_socketcan(address.channel, fd, identifiers)
        case other:
            return can.Bus(interface=other, channel=address.channel, fd=fd)


def _open_socketcan(channel: str, fd: bool, identifiers: Sequence[int]) -> can.BusABC:
    import socket

    # Exact identifiers, standard frames only; error frames pass by a filter of their own.
    filters = [can.typechecking.CanFilter(can_id=number, can_mask=0x7FF, extended=False) for number in identifiers]
    bus = can.Bus(interface="socketcan", channel=channel, fd=fd, can_filters=filters or None)
    raw: socket.socket = bus.socket  # type: ignore[attr-defined]
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
    return bus


def _advice(address: BusAddress, error: Exception) -> str:
    """Return what is wrong and what to do about it."""
    number = getattr(error, "errno", None) or getattr(error.__cause__, "errno", None)
    match address.interface, number:
        case "socketcan", errno.EAFNOSUPPORT:
            return (
                f"kernel {platform.release()} has no CAN sockets: load the module `can` (modprobe can can_raw vcan), "
                "or use --interface udp_multicast or virtual"
            )
        case "socketcan", errno.ENODEV:
            name = address.channel
            if name.startswith("vcan"):
                return f"no interface {name}: sudo ip link add {name} type vcan && sudo ip link set {name} mtu 72 up"
            return (
                f"no interface {name}: plug the adapter in, then sudo ip link set {name} up type can bitrate 1000000 "
                "dbitrate 5000000 fd on; `ip link` lists what there is"
            )
        case "socketcan", errno.ENETDOWN:
            return f"interface {address.channel} is down: sudo ip link set {address.channel} up"
        case _, errno.EPERM | errno.EACCES:
            return f"no permission to open it ({error}): run as a user who may, or ask for CAP_NET_RAW"
        case "udp_multicast", _:
            return f"{_words(error)}: allowed is a multicast address, 224.0.0.0 .. 239.255.255.255, with :PORT or not"
        case interface, _ if interface not in can.VALID_INTERFACES:
            return f"no interface of this name, allowed are {', '.join(INTERFACES)} and python-can's others"
        case _:
            return _words(error)


def _words(error: Exception) -> str:
    return str(error.__cause__ or error) or type(error).__name__


def open_buses(topology: Topology, addresses: Mapping[str, BusAddress]) -> dict[str, can.BusABC]:
    """Open every bus of a topology, or none; `DeviceUnreachable` for the first that cannot be."""
    opened: dict[str, can.BusABC] = {}
    try:
        for spec in topology.buses:
            opened[spec.name] = open_bus(addresses[spec.name], spec.profile)
    except DeviceUnreachable:
        for bus in opened.values():
            bus.shutdown()
        raise
    return opened
