"""Subscribers of the telemetry benchmark, each a process of its own: as they come, slow, or stopped."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Literal

import zenoh

from preshape.tools.zenoh_session import client_settings, open_session

Kind = Literal["live", "slow", "stopped"]
SLOW_S = 0.05
"""What a slow subscriber takes for each message, s."""
START_S = 60.0
END_S = 15.0


@dataclass(frozen=True, slots=True)
class Received:
    """What one subscriber got: events and those missing between the first and the last, states and their gaps."""

    kind: Kind
    events: int
    events_lost: int
    last_event: int
    states: int
    states_lost: int


class _Count:
    """Follows the numbers of each key."""

    def __init__(self) -> None:
        self.first: dict[str, int] = {}
        self.last: dict[str, int] = {}
        self.count: dict[str, int] = {}

    def take(self, key: str, seq: int) -> None:
        """Take note of one message."""
        self.first.setdefault(key, seq)
        self.last[key] = seq
        self.count[key] = self.count.get(key, 0) + 1

    def lost(self, states: bool) -> int:
        """Return how many numbers are missing, in the keys of states or in the others."""
        return sum(
            self.last[key] - self.first[key] + 1 - count
            for key, count in self.count.items()
            if ("/state/" in key) == states
        )


def subscribe(endpoint: str, kind: Kind, life: Connection) -> None:
    """Count what comes until told to end; say "ready" first and what came last."""
    count = _Count()
    with open_session(client_settings(endpoint)) as session:

        def take(sample: zenoh.Sample) -> None:
            count.take(str(sample.key_expr), json.loads(sample.payload.to_bytes())["seq"])
            if kind == "slow":
                time.sleep(SLOW_S)

        subscribers = [session.declare_subscriber(f"preshape/*/{tail}", take) for tail in ("state/**", "event")]
        life.send("ready")
        life.recv()
        for subscriber in subscribers:
            subscriber.undeclare()
    events = {key: number for key, number in count.count.items() if key.endswith("/event")}
    states = sum(number for key, number in count.count.items() if "/state/" in key)
    last = max((count.last[key] for key in events), default=-1)
    life.send(Received(kind, sum(events.values()), count.lost(False), last, states, count.lost(True)))


class Subscribers:
    """So many subscriber processes; a context manager. Those of kind `stopped` are stopped as soon as they are up."""

    def __init__(self, endpoint: str, kinds: tuple[Kind, ...]) -> None:
        """Start them all and wait until they listen."""
        context = multiprocessing.get_context("spawn")
        self._lives: list[Connection] = []
        self._children = []
        for kind in kinds:
            here, there = context.Pipe()
            child = context.Process(target=subscribe, args=(endpoint, kind, there), daemon=True)
            child.start()
            there.close()
            self._lives.append(here)
            self._children.append((kind, child))
        for life in self._lives:
            if not life.poll(START_S):
                raise RuntimeError(f"a subscriber was not ready within {START_S:g} s")
            life.recv()
        for kind, child in self._children:
            if kind == "stopped" and child.pid is not None:
                os.kill(child.pid, signal.SIGSTOP)

    def finish(self) -> list[Received]:
        """End those that are not stopped and return what they got."""
        received: list[Received] = []
        for life, (kind, _) in zip(self._lives, self._children, strict=True):
            if kind != "stopped":
                life.send("end")
        for life, (kind, _) in zip(self._lives, self._children, strict=True):
            if kind != "stopped" and life.poll(END_S):
                received.append(life.recv())
        return received

    def __enter__(self) -> Subscribers:
        return self

    def __exit__(self, *cause: object) -> None:
        for _, child in self._children:
            child.kill()
            child.join()
