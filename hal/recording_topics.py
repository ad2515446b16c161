"""What a recording holds: topics and schemas of its MCAP file, and how records and answers become messages."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from preshape.hal.answers import AnyAnswer
from preshape.hal.cdr import IMAGE_SCHEMA, JOINT_STATE_SCHEMA, JointStateLayout, record_schema
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.tick_record import TICK

PROFILE = "ros2"
SETUP = "preshape/setup"
"""Name of the attachment with what the controller was given: its knowledge and its options."""
GAP = "preshape/gap"
"""Name of the metadata that says which ticks could not be written."""

TICK_TOPIC = "/preshape/tick"
ANSWER_TOPIC = "/preshape/answer"
IMAGE_TOPIC = "/camera/image"


@dataclass(frozen=True, slots=True)
class Topic:
    """One channel: its topic, its messages' encoding, and name, encoding and text of their schema."""

    topic: str
    encoding: str
    schema: str
    schema_encoding: str
    text: str


def _answer_schema() -> str:
    (out,), definitions = msgspec.json.schema_components(
        [AnyAnswer], schema_hook=lambda kind: {"type": "array"}, ref_template="#/$defs/{name}"
    )
    # Viewers ask for an object at the top; which answer it is stands in its field `to`.
    return msgspec.json.encode({"type": "object", **out, "$defs": definitions}).decode()


def joint_topics() -> dict[str, slice]:
    """Return the topic of each arm and hand with its joints' place in the layout."""
    arms = {f"/{side}/arm/joint_states": LAYOUT.arm(side) for side in SIDES}
    return arms | {f"/{side}/hand/joint_states": LAYOUT.hand(side) for side in SIDES}


TOPICS = (
    Topic(TICK_TOPIC, "cdr", "preshape_msgs/msg/Tick", "ros2msg", record_schema(TICK)),
    Topic(ANSWER_TOPIC, "json", "preshape/answer/1", "jsonschema", _answer_schema()),
    Topic(IMAGE_TOPIC, "cdr", "sensor_msgs/msg/Image", "ros2msg", IMAGE_SCHEMA),
    *(Topic(name, "cdr", "sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE_SCHEMA) for name in joint_topics()),
)

JOINT_LAYOUTS = {name: JointStateLayout(tuple(np.array(LAYOUT.names)[part])) for name, part in joint_topics().items()}
"""How the joint states of each topic are written."""
