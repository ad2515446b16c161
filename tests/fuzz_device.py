"""Fuzzed payloads for every key and every call of a served device, while a client holds it armed and at rest.

`python tests/fuzz_device.py 1000000` sends so many over Zenoh, and looks whether anything has moved, stopped or ended.
"""

from __future__ import annotations

import json
import random
import sys
import time
from collections.abc import Callable

import numpy as np
from fuzz_telemetry import payloads
from served_device import ROOT, Served, served

from preshape.hal.layout import LAYOUT
from preshape.hal.remote_calls import CALLS, STREAMS
from preshape.hal.remote_device import RemoteDevice
from preshape.hal.remote_line import RemoteLine
from preshape.hal.remote_wire import encode_command
from preshape.hal.state import DeviceStatus, Mode, RobotCommand

STOPS = "stop"
"""What is taken from anyone who asks in due form, and so is asked for in no due form here."""
HOLD_EVERY = 20
"""Messages between two commands that hold the joints."""


def questions(count: int, seed: int) -> list[tuple[str, bytes]]:
    """Return calls with payloads, none of which the device's client could have sent."""
    rng = random.Random(seed)
    asked: list[tuple[str, bytes]] = []
    for payload in payloads(count, seed):
        call = rng.choice((*CALLS, "dance", "ARM", "stop "))
        if call != STOPS and rng.randrange(2):
            due = {
                "client": rng.randrange(-(2**63), 2**70),
                "now_ns": rng.randrange(2**62),
                "reason": "x" * rng.randrange(99),
            }
            payload = json.dumps(due | {"arguments": {"face": rng.choice(("+x", 3, None, [[[]]]))}}).encode()
        asked.append((call, payload))
    return asked


def commands(count: int, seed: int) -> list[bytes]:
    """Return commands of strangers, torn ones among them."""
    rng = random.Random(seed)
    position = 0.5 * (LAYOUT.lower + LAYOUT.upper)
    made: list[bytes] = []
    for payload in payloads(count, seed + 1):
        if rng.randrange(2):
            command = RobotCommand(rng.randrange(2**40), Mode.POSITION, position, LAYOUT.torque)
            payload = encode_command(command, rng.randrange(2**62), rng.randrange(4), time.monotonic_ns())
            payload = payload[: rng.choice((len(payload), rng.randrange(len(payload))))]
        made.append(payload)
    return made


def fuzz_device(server: Served, count: int, seed: int) -> dict[str, int]:
    """Send payloads to a served device that is armed and held; return how many were asked, put and refused.

    Raises:
        AssertionError: a joint has moved, the device is no longer armed, or a stranger was obeyed.
    """
    counts = {"asked": 0, "put": 0, "refused": 0}
    obeyed: list[str] = []

    def answered(call: str) -> Callable[..., None]:
        def take(reply: object) -> None:
            ok = getattr(reply, "ok", None)
            if ok is not None:
                refused = json.loads(ok.payload.to_bytes())["refused"]
                counts["refused"] += bool(refused)
                if not refused:
                    obeyed.append(call)

        return take

    with server.session() as session, server.session() as stranger:
        device = RemoteDevice(RemoteLine(session, ROOT))
        device.open()
        device.arm(time.monotonic_ns())
        until = time.monotonic() + 10.0
        while device.read(time.monotonic_ns()).status is not DeviceStatus.ARMED:
            assert time.monotonic() < until, "not armed"
            time.sleep(0.002)
        start = device.read(time.monotonic_ns()).position.copy()
        sequence = 0
        for number, ((call, question), command) in enumerate(
            zip(questions(count // 4, seed), _groups(commands(count - count // 4, seed), 3), strict=False)
        ):
            stranger.get(f"{ROOT}/call/{call}", answered(call), payload=question, timeout=5.0)
            counts["asked"] += 1
            for payload in command:
                stranger.put(f"{ROOT}/command", payload)
                stranger.put(f"{ROOT}/{STREAMS[number % len(STREAMS)]}-{number % 7}", payload)
                counts["put"] += 2
            if number % HOLD_EVERY == 0:
                sequence += 1
                device.write(RobotCommand(sequence, Mode.POSITION, start, LAYOUT.torque), time.monotonic_ns())
                time.sleep(0.004)
        time.sleep(0.5)
        sequence += 1
        device.write(RobotCommand(sequence, Mode.POSITION, start, LAYOUT.torque), time.monotonic_ns())
        state = device.read(time.monotonic_ns())
        assert state.status is DeviceStatus.ARMED, state.fault
        moved = float(np.abs(state.position - start).max())
        assert moved < 0.02, f"moved by {moved:.3f} rad"
        assert not obeyed, f"strangers were obeyed: {sorted(set(obeyed))}"
        device.close()
    assert server.process.poll() is None, "the server has ended"
    return counts


def _groups(payloads_: list[bytes], size: int) -> list[list[bytes]]:
    return [payloads_[first : first + size] for first in range(0, len(payloads_), size)]


def main(count: int) -> None:
    """Fuzz a served device and print what came of it; an assertion fails when anything has moved or ended."""
    with served() as server:
        print(f"served device: {fuzz_device(server, count, 13)}", flush=True)
    print("nothing moved, nothing ended")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
