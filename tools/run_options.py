"""How a run is done, whatever world it is done in. Imports nothing heavy: the command line reads it for its help."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.remote_options import RemoteOptions

DeviceName = Literal["mujoco", "can", "zenoh"]
ProfileName = Literal["fd", "classic"]
FieldName = Literal["grouped", "summed"]
TiesName = Literal["smooth", "hard"]
NormName = Literal["l1", "l2"]

MOST_CARRY_SPEED, MOST_CARRY_TURN_DEG = 0.2, 57.0
"""Largest speeds of a box that moves while it is passed on, m/s and deg/s."""
TASKS = 5
"""Tasks of the procedure."""
RATES_HZ = (20, 25, 40, 50, 100, 125, 200, 250, 500, 1000)
"""Rates whose period is a whole number of physics steps."""
MOST_PATIENCE = 1000
"""Largest number of cycles that modules and driver wait for each other."""
LONGEST_S = 3600.0
"""Longest time limit, s."""


RATE_HZ, MESSAGES_RATE_HZ = 500, 250
"""Ticks per second: as the paper's hands have them, and where messages between two processes of one machine take their
share of every tick."""
PATIENCE, STALLING_PATIENCE = 5, 25
"""Cycles that joints wait for a command: as the modules' firmware does, and where they are simulated in real time on a
machine whose cores are taken away for 10 to 35 ms now and then, as a virtual machine's are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """How a run is done.

    Attributes:
        device: what the joints are: simulated in MuJoCo, joint modules on CAN buses with MuJoCo behind them, or
            whatever a running `preshape serve` holds (in real time).
        paced: in real time, the physics in a process of its own; else in lockstep, as fast as it goes.
        rate_hz: ticks per second, a divisor of 1000; 0: 500, or 250 over CAN in real time and over Zenoh.
        pace: seconds of the world in each of the machine's, of one that the run itself simulates in real time: slow
            motion for a machine that is too slow; at most 1.
        interface: of the buses: virtual (lockstep), udp_multicast or socketcan (paced, and implying it); default:
            virtual, udp_multicast when paced.
        channel: of the buses, one for each; one socketcan channel alone carries all of them.
        profile: frames of the buses: CAN FD, or classic CAN, which carries less.
        patience_cycles: cycles without a command until the joints stop by themselves, and without an answer until a
            module counts as lost; 0: 5 of them, or 25 for joints that the run itself simulates in real time, where it
            is the machine that stalls.
        attach: the modules and the scene are those of a running `preshape hand-bus`.
        remote: where that server is found.
        field: minimum distance per group (the paper), or every bounding box by itself (its baseline).
        ties: smooth weights for nearly equal distances, or the paper's averaged tie set.
        norm: the distance between boxes.
        carry_speed: speed at which the right hand moves the box to and fro while the left hand comes, m/s.
        carry_turn_deg: speed at which it turns the box meanwhile, deg/s.
        feed_forward: feed that motion forward to the left hand; without it the hand only follows what it sees.
        faults: what goes wrong on the bus: a campaign's name, or a list like drop=0.01,jitter_ms=2 (see docs/can.md).
        until_task: the last task carried out; success is then judged on the tasks up to it.
        time_limit_s: simulated time after which the run ends, s.
        record: keep what recording.rrd and the plots need.
        pictures: keep what the storyboard needs.

    Raises:
        ConfigurationError: on construction, for a value out of range.
    """

    device: DeviceName = "mujoco"
    paced: bool = False
    rate_hz: int = 0
    pace: float = 1.0
    interface: str = ""
    channel: tuple[str, ...] = ()
    profile: ProfileName = "fd"
    patience_cycles: int = 0
    attach: bool = False
    remote: RemoteOptions = RemoteOptions()
    field: FieldName = "grouped"
    ties: TiesName = "smooth"
    norm: NormName = "l2"
    carry_speed: float = 0.0
    carry_turn_deg: float = 0.0
    feed_forward: bool = True
    faults: str = ""
    until_task: int = TASKS
    time_limit_s: float = 240.0
    record: bool = True
    pictures: bool = True

    def __post_init__(self) -> None:
        if self.rate_hz not in (0, *RATES_HZ):
            raise ConfigurationError(f"--rate-hz: got {self.rate_hz}, allowed are {', '.join(map(str, RATES_HZ))}")
        if not 0 <= self.patience_cycles <= MOST_PATIENCE:
            raise ConfigurationError(f"--patience-cycles: got {self.patience_cycles}, allowed is 0 .. {MOST_PATIENCE}")
        if not 0.0 < self.pace <= 1.0:
            raise ConfigurationError(f"--pace: got {self.pace:g}, allowed is > 0 and <= 1")
        if self.pace != 1.0 and not self.simulates_in_real_time:
            raise ConfigurationError(f"--pace: got {self.pace:g} for a world of another's or in lockstep, allowed is 1")
        if self.device != "can":
            self._refuse_bus_options()
        elif self.interface == "virtual" and self.in_real_time:
            raise ConfigurationError(
                "--interface: got virtual with --paced or --attach, allowed is another, for it reaches no other process"
            )
        elif self.faults and self.in_real_time:
            raise ConfigurationError(f"--faults: got {self.faults} in real time, allowed is in lockstep")
        for flag, value, most in (
            ("--carry-speed", self.carry_speed, MOST_CARRY_SPEED),
            ("--carry-turn-deg", self.carry_turn_deg, MOST_CARRY_TURN_DEG),
        ):
            if not 0.0 <= value <= most:
                raise ConfigurationError(f"{flag}: got {value:g}, allowed is 0 .. {most:g}")
        if not 1 <= self.until_task <= TASKS:
            raise ConfigurationError(f"--until-task: got {self.until_task}, allowed is 1 .. {TASKS}")
        if not 0.0 < self.time_limit_s <= LONGEST_S:
            raise ConfigurationError(f"--time-limit-s: got {self.time_limit_s:g}, allowed is > 0 and <= {LONGEST_S:g}")

    @property
    def loop_rate_hz(self) -> int:
        """Ticks per second."""
        over_messages = self.in_real_time and self.device != "mujoco"
        return self.rate_hz or (MESSAGES_RATE_HZ if over_messages else RATE_HZ)

    @property
    def patience(self) -> int:
        """Cycles without a command until the joints stop by themselves."""
        return self.patience_cycles or (STALLING_PATIENCE if self.simulates_in_real_time else PATIENCE)

    @property
    def in_real_time(self) -> bool:
        """Whether the run goes by the machine's clock."""
        return self.paced or self.attach or self.device == "zenoh" or self.interface not in ("", "virtual")

    @property
    def simulates_in_real_time(self) -> bool:
        """Whether the run starts its world itself, and that goes by the machine's clock."""
        return self.in_real_time and self.device != "zenoh" and not self.attach

    def _refuse_bus_options(self) -> None:
        given = {
            "--interface": self.interface,
            "--channel": self.channel,
            "--attach": self.attach,
            "--faults": self.faults,
        }
        for flag, value in given.items():
            if value:
                raise ConfigurationError(f"{flag}: got {value} with --device {self.device}, allowed with --device can")
