"""Waiting until every module of an open driver has answered, and saying what to do when one does not."""

from __future__ import annotations

from preshape.hal.can.device import CanDevice
from preshape.hal.clock import Clock
from preshape.hal.device import DeviceUnreachable


def await_modules(device: CanDevice, clock: Clock, within_s: float) -> None:
    """Read an open device until all its modules have answered.

    Raises:
        DeviceUnreachable: some have not, within the time; it names them.
    """
    end_ns = clock.now_ns() + round(within_s * 1e9)
    device.read(clock.now_ns())
    while device.missing and clock.now_ns() < end_ns:
        clock.sleep_until_ns(clock.now_ns() + round(device.config.period_s * 1e9))
        device.read(clock.now_ns())
    if device.missing:
        names = ", ".join(device.missing)
        raise DeviceUnreachable(
            f"no answer within {within_s:g} s from {names}: check power, bit rates and termination; "
            "without hardware start `preshape hand-bus` on the same interface and channels"
        )
