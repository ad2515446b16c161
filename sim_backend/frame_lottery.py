"""What becomes of each frame of one direction of a bus, drawn in order from a seed. Pure: no bus and no clock."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from preshape.sim_backend.fault_plan import FrameFaults

MOST_BITS = 3
"""A corrupted frame has one to this many bits turned over: CRC-16 finds all of them at 64 bytes."""


@dataclass(frozen=True, slots=True)
class Fate:
    """What becomes of one frame: how often it comes, how much later (s), after the next one or not, and its bits."""

    copies: int = 1
    delay_s: float = 0.0
    after_next: bool = False
    flipped: tuple[int, ...] = ()

    def applied(self, data: bytes) -> bytes:
        """Return the data with the bits turned over; bit k is bit k % 8 of byte k // 8."""
        if not self.flipped:
            return data
        out = bytearray(data)
        for bit in self.flipped:
            out[bit // 8] ^= 1 << (bit % 8)
        return bytes(out)


class FrameLottery:
    """Draws fates; the same seed and the same lengths of data give the same fates.

    Every frame takes the same number of draws, so one fault's chance does not move another's frames.
    `counts` says how often what was drawn.
    """

    def __init__(self, faults: FrameFaults, seed: tuple[int, ...]) -> None:
        """Draw for one direction of one bus; its seed tells it from the others."""
        self._faults = faults
        self._rng = np.random.default_rng((0xCA7, *seed))
        self.counts: Counter[str] = Counter()

    def draw(self, length: int) -> Fate:
        """Return the fate of the next frame, which has so many bytes of data."""
        faults = self._faults
        drop, duplicate, reorder, corrupt, jitter, bits = self._rng.random(6)
        self.counts["frames"] += 1
        if drop < faults.drop:
            self.counts["drop"] += 1
            return Fate(copies=0)
        twice = duplicate < faults.duplicate
        late = reorder < faults.reorder
        flipped = self._bits(length, bits) if corrupt < faults.corrupt and length else ()
        self.counts.update({"duplicate": twice, "reorder": late, "corrupt": bool(flipped)})
        return Fate(1 + twice, faults.delay_s + jitter * faults.jitter_s, late, flipped)

    def _bits(self, length: int, draw: float) -> tuple[int, ...]:
        rng = np.random.default_rng(int(draw * 2**53))
        count = int(rng.integers(1, MOST_BITS + 1))
        return tuple(int(bit) for bit in rng.choice(8 * length, count, replace=False))
