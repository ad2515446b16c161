"""Laws of telemetry over Zenoh: what the loop wrote arrives, and nothing that happens outside is felt inside."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from zenoh_robot import Loop, ask, client, free_endpoint, request, running_robot, until

from preshape.hal.device import DeviceUnreachable
from preshape.tools.telemetry import Telemetry
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.telemetry_keys import message_type
from preshape.tools.telemetry_messages import AnyMessage, Event, Heartbeat, decode_message
from preshape.tools.telemetry_states import STATES

ROOT = "preshape/box"
SHARED_MEMORY = Path("/dev/shm")


@pytest.fixture(scope="module")
def robot() -> Iterator[tuple[Loop, str]]:
    with running_robot() as running:
        yield running


def collect(session: zenoh.Session, seconds: float, keys: str = f"{ROOT}/**") -> dict[str, list[AnyMessage]]:
    """Return what arrives in a time, by the tail of its key."""
    got: dict[str, list[AnyMessage]] = defaultdict(list)
    tail = len(ROOT) + 1

    def keep(sample: zenoh.Sample) -> None:
        got[str(sample.key_expr)[tail:]].append(decode_message(sample.payload.to_bytes()))

    subscriber = session.declare_subscriber(keys, keep)
    time.sleep(seconds)
    subscriber.undeclare()
    return got


def test_a_subscriber_gets_every_stream_at_its_rate_without_gaps_and_no_other_key(robot: tuple[Loop, str]) -> None:
    with client(robot[1]) as session:
        got = collect(session, 2.5)
    assert all(message_type(tail) is type(messages[0]) for tail, messages in got.items())
    assert set(STATES) <= set(got) and {"health/loop", "health/fake", "health/telemetry"} <= set(got)
    for tail, messages in got.items():
        seqs = [message.seq for message in messages if hasattr(message, "seq")]
        assert seqs == list(range(seqs[0], seqs[0] + len(seqs))), tail
    for tail in STATES:
        rate = 20.0 if tail == "state/task" else 50.0
        assert 0.8 * rate * 2.5 <= len(got[tail]) <= 1.1 * rate * 2.5, tail
    assert {message.state for message in got["alive/loop"] if isinstance(message, Heartbeat)} == {"running"}


def test_who_comes_late_can_ask_for_what_was_said_before(robot: tuple[Loop, str]) -> None:
    with client(robot[1]) as session:
        info = ask(session, f"{ROOT}/info/*")
        events = [Event(**{k: v for k, v in e.items() if k != "schema"}) for e in ask(session, f"{ROOT}/event")]
        assert ask(session, f"{ROOT}/state/left/hand")[0]["schema"] == "preshape/joints/1"
        everything = ask(session, f"{ROOT}/**")
    assert {message["schema"] for message in info} == {"preshape/robot/1", "preshape/urdf/1", "preshape/schema/1"}
    assert [event.seq for event in events] == list(range(len(events))) and events[0].kind in ("mode", "peer")
    assert len(everything) >= len(STATES) + len(info)


def test_stop_reaches_the_loop_within_ten_ticks_and_stays(robot: tuple[Loop, str]) -> None:
    loop, endpoint = robot
    with client(endpoint) as session:
        before = loop.tick
        answer = ask(session, f"{ROOT}/call/stop", request(1, reason="enough"))[0]
        assert until(lambda: loop.stops)
        assert loop.stop_ticks[0] - before <= 10
        assert (answer["code"], loop.stops) == ("done", ["test: enough"])
        for payload in (None, b"", b"\xff{", request(1, ahead_s=-5.0)):
            assert ask(session, f"{ROOT}/call/stop", payload)[0]["code"] == "done"
        status = ask(session, f"{ROOT}/call/status")[0]
    assert loop.stops == ["test: enough"] and status["stop_reason"] == "test: enough"


def test_others_can_neither_speak_for_the_robot_nor_answer_for_it(robot: tuple[Loop, str]) -> None:
    with client(robot[1]) as liar, client(robot[1]) as listener:
        got: list[bytes] = []
        subscriber = listener.declare_subscriber(f"{ROOT}/**", lambda sample: got.append(sample.payload.to_bytes()))
        queryable = liar.declare_queryable(f"{ROOT}/call/*", lambda query: query.reply(query.key_expr, b"lie"))
        token = liar.liveliness().declare_token(f"{ROOT}/alive/liar")
        time.sleep(0.3)
        for tail in (*STATES, "event", "health/loop", "alive/loop", "info/robot"):
            liar.put(f"{ROOT}/{tail}", b"lie")
            liar.delete(f"{ROOT}/{tail}")
        answers = [reply.ok.payload.to_bytes() for reply in listener.get(f"{ROOT}/call/status") if reply.ok]
        alive = [str(reply.ok.key_expr) for reply in listener.liveliness().get(f"{ROOT}/**") if reply.ok]
        time.sleep(0.3)
        subscriber.undeclare(), queryable.undeclare(), token.undeclare()
    assert got and b"lie" not in got and b"" not in got
    assert len(answers) == 1 and b"lie" not in answers
    assert sorted(alive) == [f"{ROOT}/alive/loop", f"{ROOT}/alive/telemetry"]


def test_a_stopped_telemetry_process_shows_by_its_silence_and_disturbs_nobody() -> None:
    with running_robot() as (loop, endpoint), client(endpoint) as session:
        beats: list[float] = []
        session.declare_subscriber(f"{ROOT}/alive/telemetry", lambda sample: beats.append(time.monotonic()))
        assert until(lambda: len(beats) > 5)
        pid = loop.telemetry.process.pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        before = loop.tick
        time.sleep(0.6)
        silence_s = time.monotonic() - beats[-1]
        assert silence_s > 0.3 and loop.tick - before > 100
        os.kill(pid, signal.SIGCONT)
        count = len(beats)
        assert until(lambda: len(beats) > count)


def test_a_killed_telemetry_process_is_noted_and_the_loop_goes_on() -> None:
    with running_robot() as (loop, _):
        assert loop.telemetry.note == ""
        loop.telemetry.process.kill()
        loop.telemetry.process.join()
        before = loop.tick
        assert until(lambda: loop.tick > before + 100)
        assert loop.telemetry.note == "telemetry: its process ended with exit code -9"


def test_a_killed_telemetry_process_leaves_nothing_in_shared_memory() -> None:
    before = set(SHARED_MEMORY.glob("*.zenoh"))
    with running_robot() as (loop, endpoint):
        with client(endpoint) as session:
            assert ask(session, f"{ROOT}/call/status")
            loop.telemetry.process.kill()
            loop.telemetry.process.join()
    assert set(SHARED_MEMORY.glob("*.zenoh")) <= before


def test_two_robots_at_one_endpoint_are_told_so() -> None:
    with running_robot() as (_, endpoint), pytest.raises(DeviceUnreachable, match="telemetry: Zenoh session at tcp"):
        Telemetry(TelemetryConfig(endpoint=endpoint), "fake", True, 500.0)


def test_the_end_of_a_run_is_published_with_all_events() -> None:
    endpoint = free_endpoint()
    events: list[Event] = []
    with Telemetry(TelemetryConfig(endpoint=endpoint), "fake", True, 500.0) as telemetry, client(endpoint) as session:

        def keep(sample: zenoh.Sample) -> None:
            message = decode_message(sample.payload.to_bytes())
            assert isinstance(message, Event)
            events.append(message)

        session.declare_subscriber(f"{ROOT}/event", keep)
        time.sleep(0.2)
        loop, done = Loop(telemetry), threading.Event()
        thread = threading.Thread(target=loop.run, args=(done,))
        thread.start()
        assert until(lambda: loop.tick > 600)
        done.set()
        thread.join()
        telemetry.close()
        assert until(lambda: events and events[-1].text == "loop is gone")
    assert [event.seq for event in events] == list(range(len(events)))
    assert [event.text for event in events if event.kind == "task"] == ["grasp", "find opening"]
