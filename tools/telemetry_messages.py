"""What is said over Zenoh: one frozen type per payload, JSON with a schema id in each message.

Units are SI (rad, rad/s, N m, m, N, s) unless a name says otherwise; joint arrays are in the order of `name`; points
and poses are in the world frame. JSON has no NaN: a number that was not measured is null.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from preshape.hal.received_json import decode_received

Number = float | None
Point = list[Number]

EventKind = Literal["mode", "task", "phase", "fault", "stop", "drops", "peer", "request", "note"]
Severity = Literal["info", "warning", "error"]
PartState = Literal["running", "silent", "stopped", "gone"]


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="schema"):
    """Base of every message: frozen, keyword-only, unknown keys refused, told apart by `schema`."""


class Stamped(Message, frozen=True):
    """A message of a stream.

    Attributes:
        seq: counts the messages of this key, 0, 1, 2, ...: a gap is a loss.
        stamp_ns: when it was true, Unix time; in lockstep, simulated time from the moment the run began.
        mono_ns: the same on the loop's own clock: the machine's monotonic clock when paced, else simulated time.
    """

    seq: int
    stamp_ns: int
    mono_ns: int


class JointsState(Stamped, frozen=True, tag="preshape/joints/1"):
    """`state/<side>/{arm,hand}`: what the joints of one arm or hand measure and were commanded.

    `target` and `effort_limit` are null before the first command; `age_s` is the age of the oldest sample.
    """

    tick: int
    name: list[str]
    position: list[Number]
    velocity: list[Number]
    effort: list[Number]
    target: list[Number]
    effort_limit: list[Number]
    age_s: float


class ObjectState(Stamped, frozen=True, tag="preshape/object/1"):
    """`state/object`: the estimated pose of the object's centre, how old it is and where it comes from.

    Before anything was seen `source` is "none" and pose and age are null.
    """

    tick: int
    frame: Literal["world"]
    source: Literal["none", "perception"]
    position: Point | None
    orientation_xyzw: Point | None
    age_s: Number


class GroupState(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One of the paper's groups: its least distance, the reciprocal point there, and the force on the group."""

    distance: Number
    point: Point | None = None
    force: Point | None = None


class AimState(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a hand is on its way to: where each fingertip shall be, and its preshaping box (pose and edges)."""

    tips: dict[str, Point]
    box_position: Point | None = None
    box_orientation_xyzw: Point | None = None
    box_size: Point | None = None


class TaskState(Stamped, frozen=True, tag="preshape/task/1"):
    """`state/task`: what the controller is doing, how near each group is, and what each hand is on its way to.

    `held`: the controller was still planning, and the setpoint before was repeated. `aims` has the hands that are on
    their way to something.
    """

    tick: int
    task: int
    task_name: str
    phase: str
    mode: str
    status: str
    fault: str
    groups: dict[str, dict[str, GroupState]]
    aims: dict[str, AimState]
    held: bool


class BodyState(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One box-shaped body: its pose, and its edges along its own axes."""

    name: str
    position: Point
    orientation_xyzw: Point
    size: Point


class CameraInfo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A pinhole camera: z forward, x right, y down; its principal point lies in the middle of the image."""

    position: Point
    orientation_xyzw: Point
    focal_px: float
    width: int
    height: int


class SceneInfo(Message, frozen=True, tag="preshape/scene/1"):
    """`info/scene`: what the controller knows of its surroundings and of the object before it has seen anything."""

    bodies: list[BodyState]
    object_size: Point
    tab_size: Point
    candidate_faces: list[str]
    camera: CameraInfo


class OpeningState(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the object opens: the face, the long edge with the tab, and the tab's offset along it."""

    face: str
    edge: str
    offset: float


class SceneState(Stamped, frozen=True, tag="preshape/scene_state/1"):
    """`state/scene`, when it changes: the obstacles seen, and where the opening has been found (null before)."""

    obstacles: list[BodyState]
    opening: OpeningState | None


class ImageState(Stamped, frozen=True, tag="preshape/image/1"):
    """`state/camera`: each image that the controller has taken, as base64 of a JPEG."""

    width: int
    height: int
    jpeg: bytes


class Spread(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A distribution over the last second."""

    p50: float
    p99: float
    max: float


class Health(Stamped, frozen=True, tag="preshape/health/1"):
    """`health/<device>`: how one part keeps its time and how it is; null where a part has no such thing.

    Attributes:
        device: the part: `loop`, `telemetry`, the device's name, or one of its buses.
        rate_hz: ticks, samples or messages a second over the last second of its clock.
        jitter_us: how far the time between two of them is from its median.
        overruns: ticks so far whose lateness + compute exceeded the period.
        lateness_us, compute_us: of the loop.
        age_ms: ages of the samples when they were used.
        drops: what could not be handed on, so far.
        bus_load: share of the bus's time that is taken, 0 .. 1.
        bus_errors: error frames so far.
        temperature_c: by sensor.
    """

    device: str
    status: str
    fault: str
    count: int
    rate_hz: float
    jitter_us: Spread | None = None
    overruns: int | None = None
    lateness_us: Spread | None = None
    compute_us: Spread | None = None
    age_ms: Spread | None = None
    drops: int | None = None
    bus_load: float | None = None
    bus_errors: int | None = None
    temperature_c: dict[str, float] | None = None


class Event(Stamped, frozen=True, tag="preshape/event/1"):
    """`event`: something that happened once. Never dropped: `seq` has no gaps for whoever was there."""

    tick: int
    kind: EventKind
    severity: Severity
    text: str
    task: int


class Heartbeat(Stamped, frozen=True, tag="preshape/heartbeat/1"):
    """`alive/<part>`: a part's own heartbeat beside its liveliness token; silence of 3 periods means it has stopped."""

    part: str
    state: PartState
    period_s: float
    pid: int


class JointInfo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One joint's name and limits."""

    name: str
    lower: float
    upper: float
    velocity: float
    effort: float


class RobotInfo(Message, frozen=True, tag="preshape/robot/1"):
    """`info/robot`: what does not change in a run. `streams`: messages a second of every key."""

    robot: str
    version: str
    device: str
    paced: bool
    rate_hz: float
    pid: int
    joints: list[JointInfo]
    groups: list[str]
    tasks: list[str]
    streams: dict[str, float]


class UrdfInfo(Message, frozen=True, tag="preshape/urdf/1"):
    """`info/urdf`: the robot's description."""

    urdf: str


class SchemaInfo(Message, frozen=True, tag="preshape/schema/1"):
    """`info/schema`: which schema each key carries, and the JSON Schema (2020-12) of every one."""

    keys: dict[str, str]
    definitions: dict[str, Any]


AnyMessage = (
    JointsState | ObjectState | TaskState | SceneState | ImageState | Health | Event | Heartbeat
    | RobotInfo | UrdfInfo | SceneInfo | SchemaInfo
)  # fmt: skip
"""Everything that is published."""

_ENCODER = msgspec.json.Encoder()
_DECODER = msgspec.json.Decoder(AnyMessage)


def encode_message(message: Message) -> bytes:
    """Return a message as JSON."""
    return _ENCODER.encode(message)


def decode_message(data: bytes) -> AnyMessage:
    """Return the published message in JSON data; `msgspec.DecodeError` names what is not in its schema."""
    return decode_received(_DECODER, data)


def schema_of(kind: type[Message]) -> str:
    """Return the schema id of a type of message."""
    return str(kind.__struct_config__.tag)
