"""The arming handshake: read each module's key, set its cycle, then arm it with that key for one new session. Pure.

A key is good for one arming only: it changes when a module starts and whenever it stops. So an order to arm that
was given before a stop, however long it waited in a queue, opens nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from preshape.hal.can.parameter_codec import Reply, Request
from preshape.hal.can.topology import Module
from preshape.hal.can.vocabulary import Answer, Operation, Parameter

TAGS = 256


@dataclass(slots=True)
class _Step:
    """Where one module is: its firmware (and key) is asked for, then its cycle is set, then it is armed.

    `tags` are those of all requests for the present step: a module that is slower than the retry is heard all the same.
    """

    key: int | None = None
    timed: bool = False
    asked_ns: int | None = None
    tags: set[int] = field(default_factory=set[int])
    done: bool = False


class Arming:
    """One attempt to arm some modules for a session; `refusal` is the cause why it cannot succeed, else empty."""

    def __init__(
        self, modules: tuple[Module, ...], session: int, cycle_us: int, started_ns: int, retry_ns: int, first_tag: int
    ) -> None:
        """Begin; a request without an answer is made again after `retry_ns`. Commands come every `cycle_us`."""
        self.session = session
        self._cycle_us = cycle_us
        self.started_ns = started_ns
        self.refusal = ""
        self._names = {module.node: module.name for module in modules}
        self._retry_ns = retry_ns
        self._steps = {module.node: _Step() for module in modules}
        self._tag = first_tag

    @property
    def done(self) -> bool:
        """Whether every module has confirmed."""
        return all(step.done for step in self._steps.values())

    @property
    def waiting_for(self) -> str:
        """Names of the modules that have not confirmed."""
        return ", ".join(self._names[node] for node, step in self._steps.items() if not step.done)

    @property
    def next_tag(self) -> int:
        """The tag that the next attempt may begin with."""
        return self._tag

    def due(self, now_ns: int) -> list[tuple[int, Request]]:
        """Return the requests to be sent now, by node."""
        requests: list[tuple[int, Request]] = []
        for node, step in self._steps.items():
            if step.done or (step.asked_ns is not None and now_ns - step.asked_ns < self._retry_ns):
                continue
            self._tag = (self._tag + 1) % TAGS
            step.asked_ns = now_ns
            step.tags.add(self._tag)
            requests.append((node, self._request(step, self._tag)))
        return requests

    def _request(self, step: _Step, tag: int) -> Request:
        if step.key is None:
            return Request(Operation.READ, Parameter.FIRMWARE, tag)
        if not step.timed:
            return Request(Operation.WRITE, Parameter.CYCLE_US, tag, value=self._cycle_us)
        return Request(Operation.WRITE, Parameter.SESSION, tag, value=self.session, key=step.key)

    def take(self, node: int, reply: Reply) -> None:
        """Take a module's reply; one that answers no request of this attempt says nothing."""
        step = self._steps.get(node)
        if step is None or step.done or reply.tag not in step.tags:
            return
        step.asked_ns = None
        step.tags.clear()
        if reply.parameter is Parameter.FIRMWARE or reply.answer is Answer.WRONG_KEY:
            step.key = reply.key
        elif reply.parameter is Parameter.CYCLE_US and reply.value == self._cycle_us:
            step.timed = True
        elif reply.parameter is Parameter.SESSION and reply.answer is Answer.DONE and reply.value == self.session:
            step.done = True
        else:
            self.refusal = f"module {self._names[node]} refuses to be armed: {reply.answer.name.lower()}"
