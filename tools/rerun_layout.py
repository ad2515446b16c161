"""How a run is laid out in the rerun viewer: the one blueprint of recordings and of the live dashboard."""

from __future__ import annotations

import rerun.blueprint as rrb

from preshape.hal.layout import SIDES
from preshape.hal.sah_hand import FINGERS
from preshape.tools.series import MOST_LOOP_US

EYE, TARGET = (1.50, -0.80, 1.05), (0.33, -0.05, 0.36)
"""Where the scene is looked at from, and where to, m."""


def blueprint(live: bool = False, buses: bool = False) -> rrb.Blueprint:
    """Return the layout: scene, camera and events; states, torque against limit, distances, tracking, loop, devices.

    `live` follows the newest data; `buses` adds how the device's buses are.
    """
    eye = rrb.EyeControls3D(position=EYE, look_target=TARGET)
    left = rrb.Vertical(
        rrb.Spatial3DView(name="scene", origin="/world", eye_controls=eye),
        rrb.Horizontal(
            rrb.Spatial2DView(name="camera", origin="/world/camera"),
            rrb.TextLogView(name="events", contents=["/events"]),
            column_shares=[2, 3],
        ),
        row_shares=[5, 2],
    )
    health = [
        rrb.Horizontal(
            _plot(f"loop: lateness and compute, us (cut at {MOST_LOOP_US:g})", "/loop/timing", (0.0, MOST_LOOP_US)),
            _plot("devices: age of samples, ms", "/loop/age"),
        )
    ]
    if buses:
        health.append(
            rrb.Horizontal(
                _plot("buses: load, share of their time", "/bus/load/**", (0.0, 1.0)),
                _plot("buses: error frames so far", "/bus/errors/**"),
            )
        )
    plots = rrb.Vertical(
        rrb.StateTimelineView(name="task, phase, mode, device", contents=["/task", "/phase", "/mode", "/device"]),
        _pair("torque / limit", "torque_ratio"),
        _fingers(),
        _pair("distance of groups, m", "distance"),
        _pair("tracking error, rad", "tracking_error"),
        *health,
        row_shares=[4, *(4 + len(health)) * [3]],
    )
    panel = rrb.TimePanel(state="collapsed", timeline="time", play_state="following" if live else "paused")
    return rrb.Blueprint(
        rrb.Horizontal(left, plots, column_shares=[5, 6]),
        panel,
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _plot(name: str, path: str, values: tuple[float, float] | None = None) -> rrb.TimeSeriesView:
    axis = None if values is None else rrb.ScalarAxis(range=values)
    return rrb.TimeSeriesView(name=name, contents=[path], axis_y=axis)


def _pair(name: str, tail: str) -> rrb.Horizontal:
    return rrb.Horizontal(*(_plot(f"{side}: {name}", f"/{side}/{tail}") for side in SIDES))


def _fingers() -> rrb.Horizontal:
    """Return each hand's joint torques beside the limit they may use now, a tab for each finger."""
    tabs = (
        rrb.Tabs(*(_plot(f"{side} {finger}: torque and limit, N m", f"/{side}/{finger}/torque") for finger in FINGERS))
        for side in SIDES
    )
    return rrb.Horizontal(*tabs)
