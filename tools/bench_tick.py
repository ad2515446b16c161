"""One control tick of the real controller, stage by stage: the first approach of the box-opening run in lockstep.

Counted are ticks in which the field leads a hand: sensors are read, both hands' field is evaluated against box,
table, columns and the other arm and hand, both arms' inverse kinematics and the smoothing of all joints run.
The physics between the ticks is not counted.
"""

from __future__ import annotations

import multiprocessing
import time

import numpy as np

from preshape.control.box_opening import BoxOpening
from preshape.control.contact_policy import Phase
from preshape.control.field import Field
from preshape.control.ik import ArmIk
from preshape.control.link_boxes import LinkBoxes
from preshape.control.loop import ControlLoop
from preshape.control.loop_result import LoopConfig
from preshape.control.object_filter import ObjectFilter
from preshape.control.procedure_control import ProcedureControl
from preshape.control.smoothing import Smoother
from preshape.hal.gate import SafetyGate
from preshape.hal.tick_record import TickRecord, text_of
from preshape.hal.tick_ring import RingWriter, ring_memory
from preshape.sim_backend.device import MujocoDevice
from preshape.sim_backend.lockstep import open_lockstep
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import nominal_box, workcell
from preshape.sim_backend.texture import texture_library
from preshape.tools.bench_distances import bench_distances
from preshape.tools.stage_times import StageTimes, watching
from preshape.tools.tick_buffer import TickBuffer

STAGES = (
    "read",
    "kinematics",
    "field",
    "ik",
    "smoothing",
    "estimate",
    "rest of step",
    "gate",
    "write",
    "notify",
    "telemetry",
)
"""In the order of a tick; `rest of step` is the controller's own code around the named stages.

`loop` in the report is what remains of a tick: the record, the hash over the commands, the modes.
"""
METHODS = {
    (MujocoDevice, "read"): "read",
    (LinkBoxes, "update"): "kinematics",
    (Field, "evaluate"): "field",
    (Field, "motion"): "field",
    (ArmIk, "solve"): "ik",
    (Smoother, "update"): "smoothing",
    (ObjectFilter, "observe"): "estimate",
    (ObjectFilter, "estimate"): "estimate",
    (ProcedureControl, "step"): "rest of step",
    (ProcedureControl, "note"): "notify",
    (SafetyGate, "check"): "gate",
    (MujocoDevice, "write"): "write",
    (TickBuffer, "notify"): "notify",
    (RingWriter, "notify"): "telemetry",
}
_PHASES = (Phase.APPROACH.value, Phase.PRESHAPE.value, Phase.NEAR.value)
_LONGEST_S = 30.0


class _TickEnd:
    """The observer of every tick: closes its account, and stops the run when enough ticks are counted."""

    def __init__(self, times: StageTimes, ticks: int) -> None:
        """Count so many ticks, then stop `loop`."""
        self._times, self._left = times, ticks
        self._buffer = TickBuffer()
        self._ring = RingWriter(ring_memory(multiprocessing.get_context("spawn")))
        self.compute_us: list[float] = []
        self.loop: ControlLoop | None = None

    def notify(self, record: TickRecord) -> None:
        """Take note of one tick."""
        start = time.perf_counter_ns()
        self._buffer.notify(record)
        self._ring.notify(record)
        notify_ns = time.perf_counter_ns() - start
        keep = self._left > 0 and text_of(record, "phase") in _PHASES
        self._times.end_tick(keep)
        if keep:
            self.compute_us.append((int(record["compute_ns"]) + notify_ns) * 1e-3)
            self._left -= 1
            if self._left == 0 and self.loop is not None:
                self.loop.request_stop("enough ticks are measured")


def bench_tick(ticks: int = 1200, seed: int = 0) -> dict[str, float]:
    """Return median microseconds of every stage and of the whole tick, its p99, and what a distance costs beside.

    `ticks` at most are counted, fewer when the approach ends before. `RuntimeError` when there was none.
    """
    times = StageTimes(STAGES)
    end = _TickEnd(times, ticks)
    with watching(times, METHODS):
        _run(end, seed)
    table = times.table_us()
    if not len(table):
        raise RuntimeError("the run ended before its first approach: nothing to measure")
    report = {f"{stage.replace(' ', '_')}_us": float(np.median(table[:, k])) for k, stage in enumerate(STAGES)}
    total = np.array(end.compute_us)
    report |= {
        "loop_us": float(np.median(total - table.sum(axis=1))),
        "tick_us": float(np.median(total)),
        "tick_p99_us": float(np.percentile(total, 99)),
        "ticks": float(len(total)),
    }
    distances = bench_distances()
    wanted = (
        "l1_us_per_pair",
        "l2_us_per_pair",
        "scipy_lp_over_l1",
        "mj_geomDistance_over_l1",
        "mj_geomDistance_over_l2",
    )
    return report | {name: distances[name] for name in wanted if name in distances}


def _run(end: _TickEnd, seed: int) -> None:
    scenario = Scenario(name="bench").drawn(seed)
    world = open_lockstep(scenario)
    config = LoopConfig(max_ticks=round(_LONGEST_S * LoopConfig().rate_hz))
    controller = BoxOpening(
        workcell(scenario),
        nominal_box(scenario),
        texture_library(scenario.opening.tab_length_m, scenario.opening.tab_depth_m),
        world.perception,
        1.0 / config.rate_hz,
    )
    world.device.open()
    end.loop = ControlLoop(world.device, world.clock, SafetyGate(), end, time.perf_counter_ns, config)
    end.loop.run(controller)


if __name__ == "__main__":
    for name, value in bench_tick().items():
        print(f"{name:32s} {value:12.2f}")
