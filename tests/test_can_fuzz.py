"""Random frames into driver and modules: nothing raises, nothing moves. `tools/bus_fuzz.py` does it by the million."""

from __future__ import annotations

from itertools import islice

from preshape.hal.can.dbc_message import messages
from preshape.hal.can.topology import TOPOLOGY
from preshape.tools.bus_fuzz import fuzz, random_frames


def test_random_frames_move_nothing_and_are_counted() -> None:
    result = fuzz(30_000)
    assert result.ok
    assert result.frames >= 30_000
    assert result.sent > result.stops
    assert result.said_nothing["module damaged"] > 100
    assert result.said_nothing["module foreign frames"] > 1000


def test_the_frames_meet_every_identifier_of_the_protocol_in_its_length() -> None:
    frames = list(islice(random_frames(1), 20_000))
    met = {(frame.arbitration_id, frame.dlc) for frame in frames if not frame.is_extended_id}
    assert {(message.frame_id, message.length) for message in messages(TOPOLOGY)} <= met
    assert any(frame.is_extended_id for frame in frames) and any(frame.is_remote_frame for frame in frames)
