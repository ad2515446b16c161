"""What a count on the wire means, for hands and for arms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

JointKind = Literal["hand", "arm"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """Units of one count and widths in bits; all integers are little-endian, targets and measurements signed.

    Attributes:
        position: rad a count, of measured positions and of targets in position mode ...
        position_bits: ... and their width.
        velocity: rad/s a count, 16 bits.
        torque: N m a count of measured torques (16 bits, signed) and of torque limits (16 bits, unsigned).

    A target in torque mode has the same number of N m a count as `position` has rad.
    """

    position: float
    position_bits: Literal[16, 32]
    velocity: float
    torque: float


SCALES: Mapping[JointKind, Scale] = MappingProxyType(
    {
        "hand": Scale(position=1e-4, position_bits=16, velocity=1e-3, torque=1e-4),
        # An arm's drive gets a velocity lead from successive targets: k (d / k) dp / dt turns a step of
        # one count into about 0.2 x 250 N m s/rad x count / 2 ms: 2.5 N m at 1e-4 rad, 0.0025 N m at 1e-7.
        "arm": Scale(position=1e-7, position_bits=32, velocity=2e-4, torque=5e-3),
    }
)
