"""What of an entity is drawn: where it is known, once where it has gone, and nothing while it is not there."""

from __future__ import annotations

import numpy as np
import rerun as rr
from hypothesis import given
from hypothesis import strategies as st

from preshape.tools.rerun_stream import RerunStream


@given(st.lists(st.lists(st.booleans(), max_size=6), max_size=6))
def test_blocks_are_drawn_as_one_would_be(blocks: list[list[bool]]) -> None:
    stream = RerunStream(rr.RecordingStream("test"))
    known = [one for block in blocks for one in block]
    expected = [k for k, one in enumerate(known) if one or (k > 0 and known[k - 1])]
    drawn: list[int] = []
    begin = 0
    for block in blocks:
        drawn += (begin + stream.due("entity", np.array(block, dtype=np.bool_))).tolist()
        begin += len(block)
    assert drawn == expected
