"""The live dashboard: what a robot publishes over Zenoh, drawn into a rerun viewer."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO

import numpy as np
import PIL.Image

from preshape.hal.answers import ObstaclesAnswer
from preshape.hal.device import DeviceUnreachable
from preshape.tools.rerun_content import RerunContent
from preshape.tools.rerun_stream import RerunStream
from preshape.tools.series import MOST_LOOP_US, Series, cut_off
from preshape.tools.telemetry_listener import TelemetryListener
from preshape.tools.telemetry_messages import (
    AnyMessage,
    Event,
    Health,
    ImageState,
    SceneInfo,
    SceneState,
    UrdfInfo,
)
from preshape.tools.telemetry_records import RecordBuilder
from preshape.tools.telemetry_scene import oriented_box, surroundings
from preshape.tools.urdf_bases import arm_bases

INTERVAL_S = 0.15
"""Time between two deliveries to the viewer, s."""
MOTION_S = 0.02
"""Steps in which the scene moves, s: those in which it is published."""
LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


class LiveDash:
    """Draws one robot; `turn` every `INTERVAL_S`."""

    def __init__(
        self,
        listener: TelemetryListener,
        stream: RerunStream,
        keep: Callable[[str, AnyMessage], None] = lambda tail, message: None,
    ) -> None:
        """Draw what a listener hears into a stream; `keep` is given every message with its key's tail.

        Raises:
            DeviceUnreachable: the robot does not say what surrounds it.
        """
        self._listener, self._stream, self._keep = listener, stream, keep
        self._builder = RecordBuilder()
        first = listener.take()
        known: dict[type, AnyMessage] = {type(message): message for _, message in first}
        urdf, scene = known.get(UrdfInfo), known.get(SceneInfo)
        if not isinstance(urdf, UrdfInfo) or not isinstance(scene, SceneInfo):
            raise DeviceUnreachable("telemetry: the robot publishes no info/urdf or no info/scene to draw")
        cell, box = surroundings(scene, arm_bases(urdf.urdf))
        self._content = RerunContent(stream, cell, box, MOTION_S, MOTION_S, told_events=True)
        self.messages = 0
        self._take(first)

    def turn(self) -> None:
        """Draw what has come since the last turn."""
        self._take(self._listener.take())
        self._content.add_ticks(self._builder.records())
        self._content.flush()

    def close(self) -> None:
        """Draw what is left and end the stream."""
        self.turn()
        self._content.close()

    def _take(self, messages: list[tuple[str, AnyMessage]]) -> None:
        for tail, message in messages:
            self.messages += 1
            self._keep(tail, message)
            match message:
                case Health():
                    self._show_health(message)
                case Event():
                    text = f"{message.kind}: {message.text}"
                    self._stream.send_events(np.array([message.mono_ns]), [text], [LEVELS[message.severity]])
                case SceneState():
                    boxes = tuple(oriented_box(body) for body in message.obstacles)
                    self._content.add_answer(ObstaclesAnswer(call=0, now_ns=message.mono_ns, obstacles=boxes))
                    self._builder.add(message)
                case ImageState():
                    pixels = np.asarray(PIL.Image.open(BytesIO(message.jpeg)).convert("L"))
                    self._content.add_image(message.mono_ns, pixels)
                case _:
                    self._builder.add(message)

    def _show_health(self, health: Health) -> None:
        """Show the loop's times, or a bus's load and errors."""
        if health.lateness_us is not None and health.compute_us is not None:
            names = tuple(f"{what} {part}" for what in ("lateness", "compute") for part in ("p50", "p99", "max"))
            spreads = (health.lateness_us, health.compute_us)
            values = [value for spread in spreads for value in (spread.p50, spread.p99, spread.max)]
            series = cut_off(Series("loop/timing", names, np.array([values])), MOST_LOOP_US)
            self._stream.send_series(series, np.array([health.mono_ns]))
        if health.bus_load is not None and health.bus_errors is not None:
            self._content.add_bus(health.mono_ns, health.device, health.bus_load, health.bus_errors)


def watch(dash: LiveDash, goes_on: Callable[[], bool], nap: Callable[[float], None]) -> None:
    """Draw until `goes_on` says no, or an interrupt; `nap` sleeps so many seconds."""
    try:
        while goes_on():
            dash.turn()
            nap(INTERVAL_S)
    finally:
        # While the viewer is there: a stream to one that has gone complains for seconds.
        dash.close()
