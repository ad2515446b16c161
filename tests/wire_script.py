"""Frames of the hand bus written by cantools from the DBC file, as a test wants them: right, or wrong in one way."""

from __future__ import annotations

from binascii import crc32, crc_hqx
from collections.abc import Mapping

import numpy as np

from preshape.hal.layout import LAYOUT
from preshape.tools.wire_monitor import WireMonitor
from preshape.tools.wire_table import shipped_database

DATABASE = shipped_database()
MODULES = ("right_thumb", "right_fore", "right_middle", "right_ring")
PERIOD_S = 0.002


def frame(name: str, **values: float | str) -> tuple[int, bytes]:
    """Return identifier and data of a message with its checksum; what is not given is zero."""
    message = DATABASE.get_message_by_name(name)
    signals: dict[str, float | str] = {signal.name: 0 for signal in message.signals}
    data = bytearray(message.encode({**signals, **values}, strict=False))
    bits = next((signal.length for signal in message.signals if signal.name == "checksum"), 0)
    if bits:
        end = message.length - bits // 8
        checksum = {16: crc_hqx, 32: crc32}[bits](bytes(data[:end]), message.frame_id)
        data[end:] = checksum.to_bytes(bits // 8, "little")
    return message.frame_id, bytes(data)


def joints(owner: str) -> list[str]:
    """Return the names of the joints of a module or group."""
    return [name for name in LAYOUT.names if name.startswith(f"{owner.removesuffix('_hand')}_") and "arm" not in name]


class WireScript:
    """The right hand's bus as it should be, frame by frame; a test changes one thing."""

    def __init__(self) -> None:
        self.monitor = WireMonitor(PERIOD_S)
        self.time_s = 0.0
        self.sequence = 0
        self.session = 7
        self.position = {name: 0.3 for name in joints("right_hand")}
        self.torque = {name: 0.0 for name in joints("right_hand")}
        self.state: str = "disarmed"

    def take(self, name: str, **values: float | str) -> None:
        """Put one frame on the wire now."""
        self.monitor.take(self.time_s, *frame(name, **values))

    def arm(self) -> None:
        """Tell every module to arm."""
        for module in MODULES:
            self.take(f"{module}_request", operation="write", parameter="session", session=self.session, arming_key=5)
        self.state = "armed"

    def command(self, target: Mapping[str, float] | None = None, limit: float = 1.0, mode: str = "position",
                **values: float) -> None:  # fmt: skip
        """Send the next command: targets default to the positions, limits to a share of each joint's own."""
        self.sequence = (self.sequence + 1) % (1 << 16)
        targets = {**self.position, **(target or {})}
        self.take(
            "right_hand_command",
            **{"session": self.session, "sequence": self.sequence, "enable": 0x1FFF, "mode": mode, **values},
            **{f"{name}_target": value for name, value in targets.items()},
            **{f"{name}_limit": limit * float(LAYOUT.torque[LAYOUT.index(name)]) for name in targets},
        )

    def answer(self, taken: int = 0, **values: float) -> None:
        """Let every module report."""
        for module in MODULES:
            self.take(
                f"{module}_state",
                **{"sequence": self.sequence, "state": self.state, "taken": taken, **values},
                **{f"{name}_position": self.position[name] for name in joints(module)},
                **{f"{name}_torque": self.torque[name] for name in joints(module)},
            )

    def cycles(self, count: int, period_s: float = PERIOD_S) -> None:
        """Let so many whole cycles pass, each joint standing still."""
        for _ in range(count):
            self.command()
            self.answer(taken=1)
            self.time_s += period_s

    def begin(self) -> None:
        """Report, arm, and run for a while."""
        for _ in range(5):
            self.command(mode="poll")
            self.answer()
            self.time_s += PERIOD_S
        self.arm()
        self.cycles(20)

    def broken(self) -> dict[str, int]:
        """Return which rules have been broken how often."""
        return dict(self.monitor.verdict().broken)


def counts_of(array: np.ndarray, scale: float) -> list[int]:
    """Return values as whole counts."""
    return [round(float(value) / scale) for value in array]
