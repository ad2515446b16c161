"""Laws of the services: who is refused, and why; nothing that is malformed moves or breaks anything."""

from __future__ import annotations

import multiprocessing
import time
from pathlib import Path
from typing import Any

import pytest
from fuzz_telemetry import fuzz_over_zenoh, fuzz_services, payloads
from zenoh_robot import client, request, running_robot, until

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.run_options import RunOptions
from preshape.tools.standby import await_start
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.telemetry_file import load_telemetry
from preshape.tools.telemetry_orders import Orders, OrdersWatch, orders_memory
from preshape.tools.telemetry_requests import CLIENTS, RequestCheck
from preshape.tools.telemetry_services import Services

SPAWN = multiprocessing.get_context("spawn")


class Stage:
    """Services over orders of their own."""

    def __init__(self, *services: Any) -> None:
        self.orders = Orders(orders_memory(SPAWN))
        self.rates: list[tuple[str, float]] = []
        config = TelemetryConfig(services=services)
        self.services = Services(config, self.orders, lambda *rate: self.rates.append(rate), {"device": "fake"})

    def code(self, tail: str, payload: bytes = b"") -> str:
        """Return the answer's code."""
        answer = self.services.answer(tail, payload, time.time_ns())
        assert answer.reason
        return answer.code


def test_every_refusal_has_its_code() -> None:
    stage = Stage("start", "goal")
    stage.orders.order("waiting")
    assert stage.code("call/dance", request(1)) == "unknown"
    assert stage.code("call/arm", request(1)) == "switched_off"
    assert stage.code("call/start", b"{") == "bad_request"
    assert stage.code("call/start", b"x" * 5000) == "bad_request"
    assert stage.code("call/start", request(1, client="")) == "bad_request"
    assert stage.code("call/start", request(1, more=2)) == "bad_request"
    assert stage.code("call/start", request(1, ahead_s=-0.1)) == "expired"
    assert stage.code("call/start", request(1, ahead_s=3600.0)) == "expired"
    assert stage.code("call/goal", request(1, value=6.0)) == "out_of_range"
    assert stage.code("call/goal", request(1, value=3.0)) == "out_of_sequence"
    assert stage.code("call/goal", request(2, value=3.0)) == "done"
    assert stage.code("call/start", request(3)) == "done"
    assert (stage.orders.ordered("start"), stage.orders.ordered("until_task")) == (1, 3)


def test_starting_waits_for_arming_where_that_is_asked_for() -> None:
    stage = Stage("arm", "start")
    assert stage.code("call/start", request(1)) == "not_now"
    stage.orders.order("waiting")
    assert stage.code("call/start", request(2)) == "not_now"
    assert stage.code("call/arm", request(3)) == "done"
    assert stage.code("call/start", request(4)) == "done"


def test_nothing_is_started_after_a_stop() -> None:
    stage = Stage("arm", "start")
    stage.orders.order("waiting")
    stage.services.order_stop(b"")
    assert stage.code("call/arm", request(1)) == stage.code("call/start", request(2)) == "not_now"
    assert stage.code("call/stop") == "done"


def test_each_client_counts_for_itself_and_only_so_many_are_remembered() -> None:
    check = RequestCheck()
    for number in range(CLIENTS + 10):
        check.read(request(1, client=f"c{number}"), time.time_ns())
    assert check.read(request(1, client="c0"), time.time_ns()).seq == 1
    assert len(check._last) == CLIENTS


def test_a_stop_is_told_to_the_loop_once_with_its_first_reason() -> None:
    stage, told = Stage(), []
    watch = OrdersWatch(stage.orders, told.append)
    for payload in (b"", request(1, reason="later")):
        watch.notify(None)  # pyright: ignore
        stage.services.order_stop(payload)
    watch.notify(None), watch.notify(None)  # pyright: ignore
    assert told == ["asked for over Zenoh"]


def test_rates_can_be_set_within_their_range_and_facts_only_read() -> None:
    stage = Stage()
    assert stage.code("param/joints_hz") == "done" and not stage.rates
    assert stage.code("param/joints_hz", request(1, value=100.0)) == "done"
    assert [rate for _, rate in stage.rates] == 4 * [100.0] and stage.services.parameters["joints_hz"] == 100.0
    assert stage.code("param/joints_hz", request(2, value=0.0)) == "out_of_range"
    assert stage.code("param/device", request(3, value=1.0)) == "switched_off"
    assert stage.code("param/nothing", request(4, value=1.0)) == "unknown"


def test_a_run_that_waits_goes_on_with_the_goal_it_was_given_or_is_stopped() -> None:
    orders = Orders(orders_memory(SPAWN))
    orders.order("until_task", 2)
    orders.order("start")
    assert await_start(orders, RunOptions()).until_task == 2
    stopped = Orders(orders_memory(SPAWN))
    stopped.order_stop("no")
    assert await_start(stopped, RunOptions()).until_task == 5 and not stopped.ordered("waiting")


def test_no_payload_moves_or_breaks_the_services() -> None:
    assert fuzz_services(20_000, seed=1) == {"moved": 0, "stopped": 0}


def test_a_robot_under_fuzzed_payloads_goes_on_and_nothing_moves() -> None:
    with running_robot(services=("arm", "start", "goal")) as (loop, endpoint):
        counts = fuzz_over_zenoh(endpoint, 1500, seed=2)
        assert counts["answered"] > 0 and loop.stops == []
        assert not any(loop.telemetry.orders.ordered(name) for name in ("arm", "start", "until_task"))
        before = loop.tick
        assert until(lambda: loop.tick > before + 50) and loop.telemetry.note == ""
        with client(endpoint) as session:
            assert [reply for reply in session.get("preshape/box/call/status", timeout=5.0) if reply.ok]


def test_fuzzed_payloads_are_the_same_for_a_seed_and_differ() -> None:
    assert list(payloads(200, 5)) == list(payloads(200, 5))
    assert len(set(payloads(500, 5))) > 300


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("joints_hz = 0", ("joints_hz: got 0", "> 0 and <= 1000")),
        ("robot = 'a/b'", ("robot: got 'a/b'",)),
        ("services = ['dance']", ("services[0]: got 'dance'", "arm, goal, start")),
        ("rate = 3", ("rate: unknown key", "joints_hz")),
        ("zenoh_config = 'none.json5'", ("zenoh_config: got 'none.json5'",)),
    ],
)
def test_a_bad_configuration_is_refused_with_field_and_value(tmp_path: Path, text: str, words: tuple[str, ...]) -> None:
    file = tmp_path / "telemetry.toml"
    file.write_text(text)
    with pytest.raises(ConfigurationError) as refused:
        load_telemetry(file)
    assert all(word in str(refused.value) for word in (*words, str(file)))
