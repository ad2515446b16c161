"""Fuzzed payloads for every key and every queryable of a robot.

`python tests/fuzz_telemetry.py 1000000` sends so many over Zenoh to a robot of its own, and looks whether anything
has moved, stopped or ended.
"""

from __future__ import annotations

import json
import multiprocessing
import random
import sys
import time
from collections.abc import Iterator
from typing import Any

import msgspec
import zenoh
from zenoh_robot import client, running_robot

from preshape.hal.remote_calls import decode_question
from preshape.hal.remote_wire import COMMAND, MAGIC, STATE, decode_command, decode_state
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.telemetry_keys import SCHEMAS
from preshape.tools.telemetry_orders import Orders, orders_memory
from preshape.tools.telemetry_services import Services

CALLS = ("arm", "goal", "start", "status", "dance", "", "stop ", "STOP", "@stop")
PARAMETERS = ("joints_hz", "task_hz", "device", "nothing")
SERVICES = ("arm", "start", "goal")
BATCH = 200
_ODD: tuple[Any, ...] = (
    None, True, -1, 0, 2**63, -(2**70), 1e308, "NaN", "", "x" * 300, [], {}, [[[[[]]]]], {"a": {"b": {}}},
    "\u0000", "é",
)  # fmt: skip


def payloads(count: int, seed: int) -> Iterator[bytes]:
    """Give payloads none of which is a request that may be carried out."""
    rng = random.Random(seed)
    for _ in range(count):
        yield _payload(rng)


def _payload(rng: random.Random) -> bytes:
    match rng.randrange(9):
        case 0:
            return rng.randbytes(rng.randrange(300))
        case 1:
            return b"[" * rng.randrange(4000)
        case 2:
            return json.dumps(rng.choice(_ODD)).encode()
        case 3:
            size = rng.choice((COMMAND.itemsize, STATE.itemsize))
            return MAGIC.to_bytes(4, "little") + rng.randbytes(size - 4)
        case 4:
            # Whole and well formed, but long expired.
            return json.dumps(_request(rng) | {"expires_ns": rng.randrange(10**18)}).encode()
        case 5:
            whole = json.dumps(_request(rng)).encode()
            return whole[: rng.randrange(len(whole))]
        case 6:
            whole = bytearray(json.dumps(_request(rng)).encode())
            # Its quote, bracket or key is gone: what is left is no request.
            whole[rng.choice((0, 1, len(whole) - 1))] ^= rng.randrange(1, 256)
            return bytes(whole)
        case 7:
            # Nested without end where a value is expected.
            field = rng.choice(("schema", "client", "now_ns", "arguments", "value", "reason"))
            return b'{"' + field.encode() + b'":' + rng.choice((b"[", b'{"a":')) * 3000
        case _:
            fields = _request(rng)
            fields[rng.choice(("schema", "client", "seq", "expires_ns"))] = rng.choice(_ODD[5:])
            return json.dumps(fields).encode()


def _request(rng: random.Random) -> dict[str, Any]:
    return {
        "schema": "preshape/request/1",
        "client": rng.choice(("a", "b", "c")),
        "seq": rng.randrange(2**40),
        "expires_ns": 10**18,
        "value": rng.choice((1.0, 3.0, 100.0)),
    }


def fuzz_services(count: int, seed: int) -> dict[str, int]:
    """Hand payloads to the services and to every decoder in this process; return what they have moved."""
    orders = Orders(orders_memory(multiprocessing.get_context("spawn")))
    orders.order("waiting")
    rng = random.Random(seed)
    moved: list[object] = []
    services = Services(TelemetryConfig(services=SERVICES), orders, lambda *rate: moved.append(rate), {"device": "x"})
    tails = [f"call/{name}" for name in CALLS if name != "status"] + [f"param/{name}" for name in PARAMETERS]
    for payload in payloads(count, seed):
        answer = services.answer(rng.choice(tails), payload, time.time_ns())
        assert answer.reason and (answer.code != "done" or not payload)
        assert decode_command(payload) is None or len(payload) == COMMAND.itemsize
        assert decode_state(payload) is None or len(payload) == STATE.itemsize
        try:
            decode_question(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, ValueError):
            continue
    moved += [name for name in SERVICES if orders.ordered("until_task" if name == "goal" else name)]
    return {"moved": len(moved), "stopped": int(orders.stopped)}


def fuzz_over_zenoh(endpoint: str, count: int, seed: int) -> dict[str, int]:
    """Send payloads to every key and every queryable but `stop`; return how many, and how many answers came."""
    rng = random.Random(seed)
    counts = {"put": 0, "asked": 0, "answered": 0}
    keys = [f"preshape/box/{tail.replace('*', 'loop')}" for tail in SCHEMAS]
    keys += [f"preshape/box/device/{tail}" for tail in ("command", "state", "perception", "scene")]
    asked = [f"preshape/box/call/{name}" for name in CALLS if name and name != "status"]
    asked += [f"preshape/box/param/{name}" for name in PARAMETERS]
    asked += ["preshape/box/call/*", "preshape/box/info/robot", "preshape/box/event", "preshape/box/call/status"]

    def answered(reply: zenoh.Reply) -> None:
        counts["answered"] += reply.ok is not None

    with client(endpoint) as session:
        for number, payload in enumerate(payloads(count, seed)):
            if number % 4:
                session.put(rng.choice(keys), payload)
                counts["put"] += 1
            else:
                session.get(rng.choice(asked), answered, payload=payload, timeout=5.0)
                counts["asked"] += 1
            if number % BATCH == BATCH - 1:
                # The robot is to answer, not to be drowned.
                list(session.get("preshape/box/call/status", timeout=10.0))
        time.sleep(0.5)
    return counts


def main(count: int) -> None:
    """Fuzz a robot and print what came of it; an assertion fails when anything has moved or ended."""
    print(f"in this process: {fuzz_services(count, 11)}", flush=True)
    with running_robot(services=SERVICES) as (loop, endpoint):
        print(f"over Zenoh: {fuzz_over_zenoh(endpoint, count, 12)}", flush=True)
        orders = loop.telemetry.orders
        assert loop.stops == [] and loop.telemetry.note == ""
        assert not any(orders.ordered(name) for name in ("arm", "start", "until_task"))
        before = loop.tick
        time.sleep(1.0)
        assert loop.tick > before
        with client(endpoint) as session:
            assert [reply for reply in session.get("preshape/box/call/status", timeout=5.0) if reply.ok]
    print("nothing moved, nothing ended")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)
