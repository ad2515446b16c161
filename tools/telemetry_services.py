"""What may be asked of a running robot, and who is refused and why: pure but for the orders it gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from preshape.hal.received_json import decode_received
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.telemetry_orders import Orders
from preshape.tools.telemetry_requests import REQUEST, Answer, Refused, Request, RequestCheck
from preshape.tools.telemetry_states import TASK_NAMES

ALWAYS = ("status", "stop")
SWITCHED = ("arm", "goal", "start")
"""Services that are there only when the configuration names them."""

HIGHEST_HZ = 1000.0


class Services:
    """Answers requests. Setting a parameter and every service but status and stop takes a whole `Request`."""

    def __init__(
        self, config: TelemetryConfig, orders: Orders, set_rate: Callable[[str, float], None], facts: Mapping[str, Any]
    ) -> None:
        """Take what the services act on; `facts` are parameters that can be read only."""
        self._config, self._orders, self._set_rate = config, orders, set_rate
        self._check = RequestCheck()
        self._facts = dict(facts)
        self._rates: dict[str, tuple[str, ...]] = {
            "joints_hz": tuple(tail for tail in config.rates() if tail.endswith(("/arm", "/hand"))),
            "object_hz": ("state/object",),
            "task_hz": ("state/task",),
        }
        self._values: dict[str, float] = {name: float(getattr(config, name)) for name in self._rates}

    @property
    def parameters(self) -> dict[str, Any]:
        """All parameters and their values."""
        return self._facts | self._values

    def order_stop(self, payload: bytes) -> None:
        """Order a stop, whatever the payload is: sequence, expiry and form do not matter here."""
        self._orders.order_stop(_stop_reason(payload))

    def answer(self, tail: str, payload: bytes, now_ns: int) -> Answer:
        """Return the answer to a request at a key with this tail; `now_ns` is Unix time."""
        try:
            group, _, name = tail.partition("/")
            if group == "param":
                return self._parameter(name, payload, now_ns)
            return self._call(name, payload, now_ns)
        except Refused as refused:
            return Answer(service=tail, code=refused.code, reason=refused.reason, seq=refused.seq)

    def _call(self, name: str, payload: bytes, now_ns: int) -> Answer:
        tail = f"call/{name}"
        if name == "stop":
            # Carried out when it arrived; here is only the answer.
            return Answer(service=tail, code="done", reason=f"stop ordered: {self._orders.stop_reason}")
        if name not in SWITCHED:
            raise Refused("unknown", f"service: got {name!r}, allowed are {', '.join((*ALWAYS, *SWITCHED))}")
        if name not in self._config.services:
            raise Refused("switched_off", f"{name} is not among the services of this run's configuration")
        request = self._check.read(payload, now_ns)
        self._must_wait(name, request)
        if name == "goal":
            return self._goal(tail, request)
        if name == "start" and "arm" in self._config.services and not self._orders.ordered("arm"):
            raise Refused("not_now", "start: arm has not been asked for", request.seq)
        self._orders.order(name)
        return Answer(service=tail, code="done", reason=f"{name} ordered", seq=request.seq)

    def _must_wait(self, name: str, request: Request) -> None:
        if self._orders.stopped:
            raise Refused("not_now", f"{name}: stopped: {self._orders.stop_reason}; begin a new run", request.seq)
        if not self._orders.ordered("waiting"):
            raise Refused("not_now", f"{name}: the run does not wait for a start", request.seq)

    def _goal(self, tail: str, request: Request) -> Answer:
        value = request.value
        if value is None or value not in TASK_NAMES:
            allowed = f"1 .. {max(TASK_NAMES)}"
            raise Refused("out_of_range", f"value: got {value}, allowed is a task, {allowed}", request.seq)
        self._orders.order("until_task", int(value))
        return Answer(service=tail, code="done", reason=f"until task {int(value)}", seq=request.seq, value=value)

    def _parameter(self, name: str, payload: bytes, now_ns: int) -> Answer:
        tail = f"param/{name}"
        if name not in self.parameters:
            raise Refused("unknown", f"parameter: got {name!r}, allowed are {', '.join(self.parameters)}")
        if not payload:
            return Answer(service=tail, code="done", reason="read", value=self.parameters[name])
        request = self._check.read(payload, now_ns)
        if request.value is None:
            return Answer(service=tail, code="done", reason="read", seq=request.seq, value=self.parameters[name])
        if name not in self._values:
            raise Refused("switched_off", f"{name} can be read only", request.seq)
        if not 0.0 < request.value <= HIGHEST_HZ:
            got = f"value: got {request.value:g}, allowed is > 0 and <= {HIGHEST_HZ:g}"
            raise Refused("out_of_range", got, request.seq)
        self._values[name] = request.value
        for stream in self._rates[name]:
            self._set_rate(stream, request.value)
        return Answer(service=tail, code="done", reason="set", seq=request.seq, value=request.value)


def _stop_reason(payload: bytes) -> str:
    """Return why a stop is asked for: what the request says, as far as it can be read."""
    try:
        request = decode_received(REQUEST, payload)
    except msgspec.DecodeError:
        return "asked for over Zenoh"
    return f"{request.client}: {request.reason or 'asked for over Zenoh'}"
