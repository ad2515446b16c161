"""How a recording is laid out in the rerun viewer."""

from __future__ import annotations

import rerun.blueprint as rrb

from preshape.hal.layout import SIDES
from preshape.hal.sah_hand import FINGERS
from preshape.tools.scene_view import DEFAULT_EYE, DEFAULT_TARGET


def blueprint() -> rrb.Blueprint:
    """Return the layout: the scene large, beside it states, torque against limit, distances, loop, events."""
    torques = [f"/{side}/{finger}/torque" for side in SIDES for finger in FINGERS]
    plots = rrb.Vertical(
        rrb.StateTimelineView(name="task, phase, mode", contents=["/task", "/phase", "/mode", "/device"]),
        rrb.Horizontal(*(_plot(f"{side}: torque / limit", [f"/{side}/torque_ratio"]) for side in SIDES)),
        rrb.Horizontal(*(_plot(f"{side}: distance of groups, m", [f"/{side}/distance"]) for side in SIDES)),
        rrb.Horizontal(*(_plot(f"{side}: tracking error, rad", [f"/{side}/tracking_error"]) for side in SIDES)),
        rrb.Tabs(
            _plot("loop, us", ["/loop/timing"]),
            _plot("ages, ms", ["/loop/age"]),
            rrb.TextLogView(name="events", contents=["/events"]),
            *(_plot(path.strip("/").replace("/", " ") + ", N m", [path]) for path in torques),
        ),
        row_shares=[3, 3, 3, 2, 3],
    )
    eye = rrb.EyeControls3D(position=DEFAULT_EYE, look_target=DEFAULT_TARGET)
    scene = rrb.Spatial3DView(name="scene", origin="/world", eye_controls=eye)
    return rrb.Blueprint(rrb.Horizontal(scene, plots, column_shares=[5, 6]), collapse_panels=True)


def _plot(name: str, contents: list[str]) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(name=name, contents=contents)
