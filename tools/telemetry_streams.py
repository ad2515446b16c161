"""Which tick becomes a message of which stream: each has a rate of its own, on the loop's clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from preshape.hal.tick_record import TickRecord
from preshape.tools.telemetry_messages import Message
from preshape.tools.telemetry_states import Stamps, state_of


class _Stream:
    """One key's rate, its next time and how many messages it has had."""

    def __init__(self, rate_hz: float) -> None:
        self.interval_ns = round(1e9 / rate_hz)
        self.due_ns = -(2**62)
        self.seq = 0

    def take(self, now_ns: int) -> bool:
        """Return whether a record of this time becomes a message; times lie on a grid, however late they come."""
        if now_ns < self.due_ns:
            return False
        self.due_ns = now_ns - now_ns % self.interval_ns + self.interval_ns
        return True


class StateStreams:
    """Turns records into the messages of all state keys, numbered per key."""

    def __init__(self, rates_hz: Mapping[str, float], wall_offset_ns: int) -> None:
        """Take each key's tail and rate; `wall_offset_ns` is what the loop's clock lacks to Unix time."""
        self._streams = {tail: _Stream(rate_hz) for tail, rate_hz in rates_hz.items()}
        self._wall_offset_ns = wall_offset_ns

    def set_rate(self, tail: str, rate_hz: float) -> None:
        """Change one key's rate from the next message on."""
        self._streams[tail].interval_ns = round(1e9 / rate_hz)

    def messages(self, record: TickRecord) -> Iterator[tuple[str, Message]]:
        """Give the messages that are due with this record, each with its key's tail."""
        now_ns = int(record["now_ns"])
        for tail, stream in self._streams.items():
            if stream.take(now_ns):
                yield tail, state_of(record, tail, Stamps(stream.seq, self._wall_offset_ns))
                stream.seq += 1
