"""Random frames into driver and modules while both are at work: `python -m preshape.tools.bus_fuzz --frames 10000000`.

Half of the frames are wholly random (identifier, length, bytes; some extended or remote, a few error frames), half have
an identifier and mostly the length of the protocol, with random bytes. The driver commands one position all the time,
so frames that stop it whatever they hold are kept few. Whatever happens, nothing may raise and no joint may move.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from random import Random

import can
import numpy as np

from preshape.hal.can.bus_address import BusAddress, open_bus
from preshape.hal.can.dbc_message import messages
from preshape.hal.can.device import CanDevice
from preshape.hal.can.frame_length import FD_LENGTHS
from preshape.hal.can.identifiers import QUICK_STOP_ID
from preshape.hal.can.topology import TOPOLOGY, BusSpec
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand
from preshape.sim_backend.bare_robot import BareRobot
from preshape.sim_backend.module_rack import ModuleRack

FRAMES_A_CYCLE = 1000
"""Random frames at each end of each bus in each cycle."""
STOPS_SHARE = 0.003
"""Share of the quick stop's identifiers that stays: each ends the driver's session."""
ERRORS_SHARE = 2e-5
"""Share of error frames: half of them say that the bus is off."""
MOST_MOTION_RAD = 0.01
PERIOD_NS = 2_000_000
_NUMBERS = itertools.count()


@dataclass(frozen=True, slots=True)
class FuzzResult:
    """What came of it: frames fed, stops they caused, commands sent and taken, what became of frames, motion, rad."""

    frames: int
    stops: int
    sent: int
    taken: int
    motion_rad: float
    said_nothing: Counter[str]

    @property
    def ok(self) -> bool:
        """Whether nothing moved, and no module took more commands than were sent."""
        return self.motion_rad <= MOST_MOTION_RAD and self.taken <= self.sent


def random_frames(seed: int) -> Iterator[can.Message]:
    """Yield frames for ever."""
    random = Random(seed)
    known = [(message.frame_id, message.length) for message in messages(TOPOLOGY)]
    while True:
        frame_id, length = random.choice(known)
        kind = random.random()
        if kind < 0.5:
            frame_id, length = random.getrandbits(11), random.choice(FD_LENGTHS)
        elif kind < 0.6:
            length = random.choice(FD_LENGTHS)
        extended = kind < 0.05
        if frame_id == QUICK_STOP_ID and random.random() > STOPS_SHARE:
            frame_id, length = random.choice(known)
        yield can.Message(
            arbitration_id=random.getrandbits(29) if extended else frame_id,
            is_extended_id=extended,
            is_remote_frame=0.05 <= kind < 0.07,
            is_error_frame=0.07 <= kind < 0.07 + ERRORS_SHARE,
            is_fd=True,
            data=random.randbytes(length),
        )


class FuzzedBus(can.BusABC):
    """One end of a bus; `load` puts random frames before what is really there."""

    def __init__(self, bus: can.BusABC, frames: Iterator[can.Message]) -> None:
        """Wrap an end of a bus."""
        super().__init__(channel=bus.channel_info)
        self.channel_info = bus.channel_info
        self._bus, self._frames = bus, frames
        self._loaded = 0

    def load(self, count: int) -> None:
        """Let the next so many frames received be random ones."""
        self._loaded += count

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame."""
        self._bus.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self._loaded:
            self._loaded -= 1
            return next(self._frames), True
        return self._bus.recv(timeout), True

    def shutdown(self) -> None:
        """Close the bus."""
        super().shutdown()
        self._bus.shutdown()


class _Rig:
    """Driver and modules of the bare robot, every end of every bus fuzzed."""

    def __init__(self, seed: int) -> None:
        self.frames = random_frames(seed)
        self.ends: list[FuzzedBus] = []
        number = next(_NUMBERS)
        self.channels = {spec.name: f"fuzz-{number}-{spec.name}" for spec in TOPOLOGY.buses}
        self.robot = BareRobot(seed)
        self.rack = ModuleRack(TOPOLOGY, self.robot, {s.name: self._end(s, []) for s in TOPOLOGY.buses}, seed, 0.0015)
        random = Random(seed)
        self.device = CanDevice(TOPOLOGY, self._end, draw=lambda: random.getrandbits(32))
        self.start = self.robot.position.copy()
        self.sequence = self.sent = self.stops = 0

    def _end(self, spec: BusSpec, identifiers: list[int]) -> can.BusABC:
        bus = FuzzedBus(open_bus(BusAddress("virtual", self.channels[spec.name]), spec.profile), self.frames)
        self.ends.append(bus)
        return bus

    def arm(self) -> None:
        """Open the driver anew and arm it, without random frames."""
        self.device.close()
        self.ends = self.ends[: len(TOPOLOGY.buses)]
        self.device.open()
        self.sequence = 0
        for turn in range(200):
            status = self.device.read(self.robot.time_ns).status
            if status is DeviceStatus.ARMED:
                return
            if turn % 50 == 10:
                self.device.arm(self.robot.time_ns)
            self.robot.step(2)
        raise RuntimeError("fuzz: driver and modules do not arm any more without random frames")

    def cycle(self, count: int) -> float:
        """Run one cycle with random frames at every end; return the largest motion so far, rad."""
        for end in self.ends:
            end.load(count)
        now_ns = self.robot.time_ns
        if self.device.read(now_ns).status is not DeviceStatus.ARMED:
            self.stops += 1
            self.robot.step(2)
            self.arm()
            now_ns = self.robot.time_ns
        self.sequence += 1
        self.sent += self.device.write(RobotCommand(self.sequence, Mode.POSITION, self.start, LAYOUT.torque), now_ns)
        self.robot.step(2)
        return float(np.abs(self.robot.position - self.start).max())

    def close(self) -> None:
        self.device.close()
        self.rack.close()


def fuzz(frames: int, seed: int = 0, told: Callable[[int], None] = lambda fed: None) -> FuzzResult:
    """Feed at least so many random frames; `told` is called after every cycle with how many it were.

    Raises:
        RuntimeError: driver and modules can no longer be armed.
    """
    rig = _Rig(seed)
    fed, motion_rad = 0, 0.0
    said_nothing: Counter[str] = Counter()
    try:
        rig.arm()
        while fed < frames:
            motion_rad = max(motion_rad, rig.cycle(FRAMES_A_CYCLE))
            fed += FRAMES_A_CYCLE * len(rig.ends)
            told(fed)
        modules = rig.rack.modules.values()
        for module in modules:
            said_nothing.update({f"module {name}": n for name, n in module.counts.items() if name != "taken"})
        for wire in rig.rack.wires.values():
            said_nothing["module foreign frames"] += wire.counts["foreign"]
        taken = max(module.counts["taken"] for module in modules)
    finally:
        rig.close()
    return FuzzResult(fed, rig.stops, rig.sent, taken, motion_rad, said_nothing)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz and print; 1 if something moved."""
    parser = argparse.ArgumentParser(prog="python -m preshape.tools.bus_fuzz", description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)

    def told(fed: int) -> None:
        if fed % 240_000 == 0:
            print(f"{fed:,} frames", file=sys.stderr, flush=True)

    result = fuzz(options.frames, options.seed, told)
    print(f"{result.frames:,} random frames: no exception, {result.stops:,} stops, motion {result.motion_rad:.5f} rad")
    print(f"commands sent {result.sent:,}, taken by a module at most {result.taken:,}")
    for name, count in sorted(result.said_nothing.items()):
        print(f"  {name}: {count:,}")
    return 0 if result.ok else 1


if __name__ == "__main__":
    sys.exit(main())
