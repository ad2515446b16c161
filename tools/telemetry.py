"""Telemetry as a run sees it: a ring to write to, orders to obey, and a process that may die without harm."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from preshape.control.loop import ControlLoop
from preshape.control.observer import Observer, Observers
from preshape.hal.answers import AnyAnswer, PoseAnswer
from preshape.hal.byte_ring import CAPACITY, PIECE, ByteWriter
from preshape.hal.description import robot_urdf
from preshape.hal.device import DeviceUnreachable
from preshape.hal.layout import Side
from preshape.hal.tick_ring import RingWriter, ring_memory
from preshape.hal.transform import Matrix
from preshape.tools.answer_pack import pack
from preshape.tools.child_process import await_end
from preshape.tools.part_figures import parts_memory
from preshape.tools.telemetry_bridge import BridgeMemory, RobotFacts, run_bridge
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.telemetry_messages import SceneInfo
from preshape.tools.telemetry_orders import Orders, OrdersWatch, orders_memory

START_S = 30.0
"""Longest time until the process is ready, s."""
END_S = 5.0
"""Longest time it may take to send what is left, s."""
READER = 0
"""The telemetry process's place among the ring's readers."""


class Telemetry:
    """The telemetry process of one run: a context manager; `watch` before the loop runs.

    `parts` takes what a device knows of its parts. After it is up nothing that happens to it is felt by the loop:
    records go into shared memory, and are lost.
    """

    def __init__(
        self,
        config: TelemetryConfig,
        device: str,
        paced: bool,
        rate_hz: float,
        X_world_base: Mapping[Side, Matrix] | None = None,
        scene: SceneInfo | None = None,
    ) -> None:
        """Start the process and wait until it listens.

        Raises:
            DeviceUnreachable: it cannot; the message says why.
        """
        context = multiprocessing.get_context("spawn")
        heard = ring_memory(context, CAPACITY, PIECE)
        memory = BridgeMemory(ring_memory(context), heard, parts_memory(context), orders_memory(context))
        self.orders = Orders(memory.orders)
        self._writer, self._answers = RingWriter(memory.ring), ByteWriter(RingWriter(heard, PIECE))
        self.parts = memory.parts
        self.waits_for_start = "start" in config.services
        urdf = robot_urdf(X_world_base)
        facts = RobotFacts(device=device, paced=paced, rate_hz=rate_hz, pid=os.getpid(), urdf=urdf, scene=scene)
        self._life, there = context.Pipe()
        self.process = context.Process(
            name="telemetry", target=run_bridge, args=(config, facts, READER, memory, there), daemon=True
        )
        self.process.start()
        there.close()
        problem = self._first_word()
        if problem:
            self.close()
            raise DeviceUnreachable(f"telemetry: {problem}")

    def observers(self, request_stop: Callable[[str], None]) -> list[Observer]:
        """Return what is to be told of every tick: it writes to the ring, and obeys orders."""
        return [self._writer, OrdersWatch(self.orders, request_stop)]

    def watch(self, loop: ControlLoop, observers: Observers) -> None:
        """Write every tick of a loop into the ring, and hand a stop that is asked for on to it.

        A stop from before is handed on at once: a run that was stopped while it waited is not armed at all.
        """
        if self.orders.stopped:
            loop.request_stop(self.orders.stop_reason)
        for observer in self.observers(loop.request_stop):
            observers.add(observer)

    def hear(self, answer: AnyAnswer, pixels: NDArray[np.uint8] | None) -> None:
        """Hand over what the controller has been told of its surroundings; never waits."""
        if not isinstance(answer, PoseAnswer):
            self._answers.send(pack(answer, pixels))

    @property
    def note(self) -> str:
        """What went wrong with the process so far, in one line; empty if nothing did."""
        if self.process.is_alive():
            return ""
        return f"telemetry: its process ended with exit code {self.process.exitcode}"

    def close(self) -> None:
        """End the process once it has published what is left; may be called twice."""
        self._writer.end()
        await_end(self.process, END_S)
        self._life.close()

    def __enter__(self) -> Telemetry:
        return self

    def __exit__(self, *cause: object) -> None:
        self.close()

    def _first_word(self) -> str:
        try:
            if self._life.poll(START_S):
                return self._life.recv()
        except EOFError:
            return "its process ended before it was ready"
        return f"not ready within {START_S:g} s"
