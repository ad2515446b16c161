"""What does not change in a run: the robot, its description, and the schemas of all messages."""

from __future__ import annotations

import os
from collections.abc import Mapping

import msgspec

from preshape import __version__
from preshape.hal.layout import LAYOUT
from preshape.hal.tick_record import GROUPS
from preshape.tools.telemetry_keys import SCHEMAS
from preshape.tools.telemetry_messages import JointInfo, RobotInfo, SchemaInfo, schema_of
from preshape.tools.telemetry_states import TASK_NAMES


def robot_info(robot: str, device: str, paced: bool, rate_hz: float, streams: Mapping[str, float]) -> RobotInfo:
    """Return what one needs to know of the robot to read its streams."""
    limits = zip(LAYOUT.names, LAYOUT.lower, LAYOUT.upper, LAYOUT.velocity, LAYOUT.torque, strict=True)
    return RobotInfo(
        robot=robot,
        version=__version__,
        device=device,
        paced=paced,
        rate_hz=rate_hz,
        pid=os.getpid(),
        joints=[
            JointInfo(name=name, lower=float(low), upper=float(high), velocity=float(speed), effort=float(effort))
            for name, low, high, speed, effort in limits
        ],
        groups=list(GROUPS),
        tasks=list(TASK_NAMES.values()),
        streams=dict(streams),
    )


def schema_info() -> SchemaInfo:
    """Return the JSON Schema of every message, and which key carries which."""
    kinds = sorted(set(SCHEMAS.values()), key=schema_of)
    references, components = msgspec.json.schema_components(kinds, ref_template="#/definitions/{name}")
    named = {schema_of(kind): reference for kind, reference in zip(kinds, references, strict=True)}
    keys = {f"preshape/<robot>/{tail}": schema_of(kind) for tail, kind in SCHEMAS.items()}
    return SchemaInfo(keys=keys, definitions={**components, **named})
