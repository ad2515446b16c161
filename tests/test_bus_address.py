"""Buses that cannot be opened: exit code 3 and one line that says what to do; and which channel is whose."""

from __future__ import annotations

import errno

import can
import pytest

from preshape.hal.can import bus_address
from preshape.hal.can.bus_address import BusAddress, bus_addresses, open_bus
from preshape.hal.can.topology import TOPOLOGY
from preshape.hal.device import DeviceUnreachable
from preshape.tools.cli import run_command
from preshape.tools.exit_codes import ExitCode

NAMES = ["right_hand", "left_hand", "arms"]


def reason(interface: str, channel: str) -> str:
    """Return the one line that opening a bus fails with."""
    with pytest.raises(DeviceUnreachable) as caught:
        open_bus(BusAddress(interface, channel), "fd")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def failing(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    """Let every bus fail to open with an error, as the kernel would."""

    def refuse(**options: object) -> can.BusABC:
        raise error

    monkeypatch.setattr(bus_address.can, "Bus", refuse)


def test_an_unknown_interface_is_named_with_those_there_are() -> None:
    assert "no interface of this name, allowed are virtual, socketcan, udp_multicast" in reason("cannbus", "0")


def test_an_address_that_is_no_multicast_address_is_named_with_what_is_allowed() -> None:
    assert "allowed is a multicast address, 224.0.0.0 .. 239.255.255.255" in reason("udp_multicast", "127.0.0.1:43113")


@pytest.mark.parametrize(
    ("error", "channel", "advice"),
    [
        (OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol"), "can0", "modprobe can"),
        (OSError(errno.ENODEV, "No such device"), "vcan0", "sudo ip link add vcan0 type vcan"),
        (OSError(errno.ENODEV, "No such device"), "can7", "no interface can7: plug the adapter in"),
        (can.CanInitializationError("down", errno.ENETDOWN), "can0", "down"),
        (OSError(errno.ENETDOWN, "Network is down"), "can0", "sudo ip link set can0 up"),
        (PermissionError(errno.EPERM, "Operation not permitted"), "can0", "no permission to open it"),
    ],
)
def test_what_the_kernel_says_becomes_what_to_do(
    monkeypatch: pytest.MonkeyPatch, error: Exception, channel: str, advice: str
) -> None:
    failing(monkeypatch, error)
    text = reason("socketcan", channel)
    assert text.startswith(f"bus socketcan {channel}: ") and advice in text


@pytest.mark.parametrize("command", ["run --device can --attach", "hand-bus --physics simple"])
def test_the_command_line_ends_with_code_3_and_one_line(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [*command.split(), "--interface", "udp_multicast", "--channel", "10.0.0.1"]
    assert run_command(arguments) == ExitCode.UNREACHABLE
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith(f"preshape {arguments[0]}: bus udp_multicast 10.0.0.1:43113: ")


def test_channels_are_one_for_each_bus_or_numbered_from_one() -> None:
    channels = {
        name: address.channel for name, address in bus_addresses(TOPOLOGY, "socketcan", ["a", "b", "c"]).items()
    }
    assert channels == dict(zip(NAMES, "abc", strict=True))
    assert [a.channel for a in bus_addresses(TOPOLOGY, "virtual", ["v"]).values()] == ["v", "v.1", "v.2"]
    ports = [a.channel for a in bus_addresses(TOPOLOGY, "udp_multicast", ["239.0.0.1:5000"]).values()]
    assert ports == ["239.0.0.1:5000", "239.0.0.1:5001", "239.0.0.1:5002"]
    assert [a.channel for a in bus_addresses(TOPOLOGY, "socketcan").values()] == ["can0", "can1", "can2"]
    with pytest.raises(ValueError, match="channels: got 2, allowed are 3, for right_hand, left_hand, arms"):
        bus_addresses(TOPOLOGY, "socketcan", ["can0", "can1"])


def test_one_socketcan_channel_takes_a_topology_of_one_bus() -> None:
    one = TOPOLOGY.on_one_bus()
    assert len(one.buses) == 1 and one.groups == TOPOLOGY.groups
    assert [str(address) for address in bus_addresses(one, "socketcan", ["vcan0"]).values()] == ["socketcan vcan0"]


def test_a_port_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="channel 239.0.0.1:x: got port 'x', allowed is 1 .. 65535"):
        bus_addresses(TOPOLOGY, "udp_multicast", ["239.0.0.1:x"])
