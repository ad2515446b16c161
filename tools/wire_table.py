"""What a frame of the hand bus says, read from the shipped DBC file alone: none of the driver's code is used."""

from __future__ import annotations

from binascii import crc32, crc_hqx
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

import cantools
import numpy as np
from cantools.database.can import Database, Message, Signal
from numpy.typing import NDArray

from preshape.hal.layout import LAYOUT

KINDS = ("command", "state", "emergency", "heartbeat", "request", "reply", "quick_stop")
"""The last part of a message's name: what it is. Before it stands whose it is: a group's or a module's."""
CHECKSUM = "checksum"
CHECKSUMS: Mapping[int, Callable[[bytes, int], int]] = {16: crc_hqx, 32: crc32}
"""Width in bits -> the checksum of a frame's content before it, started with the identifier."""


@dataclass(frozen=True, slots=True)
class Column:
    """One quantity of several joints, side by side: integers of one type from a byte on, and their unit."""

    joints: tuple[str, ...]
    offset: int
    dtype: np.dtype[np.int_]
    scale: float

    @property
    def indices(self) -> NDArray[np.int64]:
        """Places of the joints in the layout."""
        return np.array([LAYOUT.index(joint) for joint in self.joints])

    def read(self, data: bytes) -> NDArray[np.float64]:
        """Return the values, in the DBC file's unit."""
        counts = np.frombuffer(data, self.dtype, len(self.joints), self.offset)
        return counts.astype(np.float64) * self.scale


class FrameTable:
    """Where everything stands in one message.

    `kind` and `owner` come from its name; `columns` holds the quantities of joints by their name (`target`,
    `torque`); `choices` the words for the numbers of those signals that have words.
    """

    def __init__(self, message: Message) -> None:
        """Read a message's description; `ValueError` for a name that says nothing."""
        kind = next((kind for kind in KINDS if message.name == kind or message.name.endswith(f"_{kind}")), None)
        if kind is None:
            raise ValueError(f"message {message.name}: got an unknown kind, allowed are {', '.join(KINDS)}")
        self.name, self.kind, self.length, self.frame_id = message.name, kind, message.length, message.frame_id
        self.owner = message.name.removesuffix(kind).rstrip("_")
        of_joints = [signal for signal in message.signals if _joint(signal)]
        self.columns = _columns(of_joints)
        words = [signal for signal in message.signals if not _joint(signal)]
        self._places = {signal.name: (signal.start, (1 << signal.length) - 1) for signal in words}
        self.choices = {
            signal.name: {int(number): str(word) for number, word in signal.choices.items()}
            for signal in words
            if signal.choices
        }
        self._checksum_bits = next((signal.length for signal in words if signal.name == CHECKSUM), 0)

    def number(self, name: str, data: bytes) -> int:
        """Return an unsigned whole number by the name of its signal."""
        start, mask = self._places[name]
        return int.from_bytes(data, "little") >> start & mask

    def word(self, name: str, data: bytes) -> str:
        """Return the word for a number; the number itself where there is none."""
        number = self.number(name, data)
        return self.choices[name].get(number, str(number))

    def intact(self, data: bytes) -> bool:
        """Return whether length and checksum are as they must be."""
        if len(data) != self.length:
            return False
        if not self._checksum_bits:
            return True
        end = self.length - self._checksum_bits // 8
        return CHECKSUMS[self._checksum_bits](data[:end], self.frame_id) == int.from_bytes(data[end:], "little")


def shipped_database() -> Database:
    """Return the DBC file that ships with the package."""
    database = cantools.database.load_string((files("preshape.hal.can") / "hand_bus.dbc").read_text(), "dbc")
    assert isinstance(database, Database)
    return database


def frame_tables(database: Database | None = None) -> dict[int, FrameTable]:
    """Return the tables of all messages of a database, by identifier; default: the shipped one."""
    return {message.frame_id: FrameTable(message) for message in (database or shipped_database()).messages}


def _joint(signal: Signal) -> str:
    """Return the joint that a signal belongs to, or an empty text."""
    joint, _, what = signal.name.rpartition("_")
    return joint if what and joint in LAYOUT.names else ""


def _columns(signals: Sequence[Signal]) -> dict[str, Column]:
    columns: dict[str, Column] = {}
    for what in dict.fromkeys(signal.name.rpartition("_")[2] for signal in signals):
        column = [signal for signal in signals if signal.name.endswith(f"_{what}")]
        column.sort(key=lambda signal: signal.start)
        first = column[0]
        places = [first.start + place * first.length for place in range(len(column))]
        if first.start % 8 or places != [signal.start for signal in column]:
            raise ValueError(f"signals {what} of {first.name}: got gaps between them, allowed is none")
        dtype = np.dtype(f"<{'i' if first.is_signed else 'u'}{first.length // 8}")
        columns[what] = Column(tuple(map(_joint, column)), first.start // 8, dtype, float(first.scale))
    return columns
