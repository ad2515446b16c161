"""How a run is done, whatever world it is done in. Imports nothing heavy: the command line reads it for its help."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from preshape.tools.configuration_error import ConfigurationError

DeviceName = Literal["mujoco"]
FieldName = Literal["grouped", "summed"]
TiesName = Literal["smooth", "hard"]
NormName = Literal["l1", "l2"]

LONGEST_S = 3600.0
"""Longest time limit, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """How a run is done.

    Attributes:
        device: what the joints are: simulated in MuJoCo.
        paced: in real time at 500 Hz, the physics in a process of its own; else in lockstep, as fast as it goes.
        field: minimum distance per group (the paper), or every bounding box by itself (its baseline).
        ties: smooth weights for nearly equal distances, or the paper's averaged tie set.
        norm: the distance between boxes.
        time_limit_s: simulated time after which the run ends, s.
        record: keep what recording.rrd and the plots need.
        pictures: keep what the storyboard needs.

    Raises:
        ConfigurationError: on construction, for a time limit out of range.
    """

    device: DeviceName = "mujoco"
    paced: bool = False
    field: FieldName = "grouped"
    ties: TiesName = "smooth"
    norm: NormName = "l2"
    time_limit_s: float = 180.0
    record: bool = True
    pictures: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.time_limit_s <= LONGEST_S:
            raise ConfigurationError(f"--time-limit-s: got {self.time_limit_s:g}, allowed is > 0 and <= {LONGEST_S:g}")
