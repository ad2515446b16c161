"""How a run is done, whatever world it is done in. Imports nothing heavy: the command line reads it for its help."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from preshape.tools.configuration_error import ConfigurationError

DeviceName = Literal["mujoco"]
FieldName = Literal["grouped", "summed"]
TiesName = Literal["smooth", "hard"]
NormName = Literal["l1", "l2"]

MOST_CARRY_SPEED, MOST_CARRY_TURN_DEG = 0.2, 57.0
"""Largest speeds of a box that moves while it is passed on, m/s and deg/s."""
TASKS = 5
"""Tasks of the procedure."""
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
        carry_speed: speed at which the right hand moves the box to and fro while the left hand comes, m/s.
        carry_turn_deg: speed at which it turns the box meanwhile, deg/s.
        feed_forward: feed that motion forward to the left hand; without it the hand only follows what it sees.
        faults: what goes wrong on the bus: a campaign's name, or a list like drop=0.01,jitter_ms=2 (see README).
        until_task: the last task carried out; success is then judged on the tasks up to it.
        time_limit_s: simulated time after which the run ends, s.
        record: keep what recording.rrd and the plots need.
        pictures: keep what the storyboard needs.

    Raises:
        ConfigurationError: on construction, for a value out of range.
    """

    device: DeviceName = "mujoco"
    paced: bool = False
    field: FieldName = "grouped"
    ties: TiesName = "smooth"
    norm: NormName = "l2"
    carry_speed: float = 0.0
    carry_turn_deg: float = 0.0
    feed_forward: bool = True
    faults: str = ""
    until_task: int = TASKS
    time_limit_s: float = 180.0
    record: bool = True
    pictures: bool = True

    def __post_init__(self) -> None:
        for flag, value, most in (
            ("--carry-speed", self.carry_speed, MOST_CARRY_SPEED),
            ("--carry-turn-deg", self.carry_turn_deg, MOST_CARRY_TURN_DEG),
        ):
            if not 0.0 <= value <= most:
                raise ConfigurationError(f"{flag}: got {value:g}, allowed is 0 .. {most:g}")
        if self.faults and self.device == "mujoco":
            raise ConfigurationError(
                f"--faults: got {self.faults!r}, allowed is none with --device mujoco: it has no bus"
            )
        if not 1 <= self.until_task <= TASKS:
            raise ConfigurationError(f"--until-task: got {self.until_task}, allowed is 1 .. {TASKS}")
        if not 0.0 < self.time_limit_s <= LONGEST_S:
            raise ConfigurationError(f"--time-limit-s: got {self.time_limit_s:g}, allowed is > 0 and <= {LONGEST_S:g}")
