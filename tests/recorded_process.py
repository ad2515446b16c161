"""A process that hands 500 ticks a second to a recorder until it is killed; prints when it has begun."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from preshape.hal.answers import PoseAnswer
from preshape.hal.layout import LAYOUT
from preshape.hal.state import RobotState
from preshape.hal.tick_record import new_record, note_state
from preshape.hal.world import PoseSample
from preshape.sim_backend.scenario import Scenario
from preshape.tools.controller_setup import setup_of
from preshape.tools.recorder import Recorder
from preshape.tools.run_options import RunOptions


def main(directory: Path) -> None:
    """Record until killed."""
    with Recorder(directory) as recorder:
        recorder.start(paced=True)
        recorder.begin(setup_of(Scenario(name="test").drawn(0), RunOptions(paced=True)))
        print("ready", flush=True)
        record = new_record()
        for tick in range(10**6):
            now_ns = time.monotonic_ns()
            zero = np.zeros(LAYOUT.dof)
            state = RobotState(tick, zero, zero, zero, np.full(LAYOUT.dof, now_ns))
            note_state(record, tick, now_ns, state)
            recorder.hear(PoseAnswer(call=tick, now_ns=now_ns, sample=PoseSample(now_ns, np.eye(4))), None)
            recorder.notify(record)
            time.sleep(0.002)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
