"""The key space: `preshape/<robot>/...`, one place for every name in it."""

from __future__ import annotations

import re

from preshape.hal.layout import SIDES, Side
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.telemetry_messages import (
    Event,
    Health,
    Heartbeat,
    ImageState,
    JointsState,
    Message,
    ObjectState,
    RobotInfo,
    SceneInfo,
    SceneState,
    SchemaInfo,
    TaskState,
    UrdfInfo,
)

ROBOT = "box"
"""The robot's id when none is given."""

LIMBS = ("arm", "hand")
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")

SCHEMAS: dict[str, type[Message]] = {
    **{f"state/{side}/{limb}": JointsState for side in SIDES for limb in LIMBS},
    "state/object": ObjectState,
    "state/task": TaskState,
    "state/scene": SceneState,
    "state/camera": ImageState,
    "health/*": Health,
    "event": Event,
    "alive/*": Heartbeat,
    "info/robot": RobotInfo,
    "info/urdf": UrdfInfo,
    "info/scene": SceneInfo,
    "info/schema": SchemaInfo,
}
"""What every published key carries; `*` stands for one part of a key."""


def check_name(name: str, field: str = "--robot") -> str:
    """Return a name that may be one part of a key.

    Raises:
        ConfigurationError: it holds what Zenoh gives a meaning (`/`, `*`, `$`, `?`, `#`, `@`), or nothing.
    """
    if not _NAME.fullmatch(name):
        allowed = "1 to 64 letters, digits, _, . and -, the first a letter, a digit or _"
        raise ConfigurationError(f"{field}: got {name!r}, allowed are {allowed}")
    return name


class Keys:
    """The keys of one robot."""

    def __init__(self, robot: str = ROBOT) -> None:
        """Take the robot's id, which every key begins with."""
        self.robot = check_name(robot)
        self.root = f"preshape/{robot}"

    def of(self, tail: str) -> str:
        """Return the key with this tail, as in `SCHEMAS`."""
        return f"{self.root}/{tail}"

    def joints(self, side: Side, limb: str) -> str:
        """Return the key of one arm or hand."""
        return self.of(f"state/{side}/{limb}")

    def tail(self, key: str) -> str:
        """Return a key without the robot's part; `ValueError` if it is another robot's."""
        if not key.startswith(f"{self.root}/"):
            raise ValueError(f"key: got {key}, allowed is {self.root}/...")
        return key[len(self.root) + 1 :]


def message_type(tail: str) -> type[Message] | None:
    """Return what the key with this tail carries, None for a key that does not exist."""
    exact = SCHEMAS.get(tail)
    head, _, last = tail.rpartition("/")
    return exact or (SCHEMAS.get(f"{head}/*") if _NAME.fullmatch(last) else None)
