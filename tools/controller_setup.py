"""All that a run's controller, gate and loop are made of: nominal knowledge and options, never simulator truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import msgspec
import numpy as np

from preshape.control.box_opening import BoxOpening
from preshape.control.carrier import CarryOptions
from preshape.control.field import FieldOptions
from preshape.control.loop_result import LoopConfig
from preshape.control.object_lift import ObjectLift
from preshape.control.procedure_control import ProcedureControl
from preshape.hal.answers import plain, rebuilt
from preshape.hal.gate_config import GateConfig
from preshape.hal.object_shape import ShapeName
from preshape.hal.transform import Matrix
from preshape.hal.world import NominalBox, Opening, Perception, TextureLibrary, Workcell
from preshape.sim_backend.referee_report import LIFT_TASK_NAMES
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import nominal_box, workcell
from preshape.sim_backend.texture import texture_library
from preshape.tools.planned_task import shaped_object
from preshape.tools.run_options import RunOptions


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControllerSetup:
    """What makes a controller: a recording keeps it, a replay builds the same one from it.

    Attributes:
        schema: of this value in a recording.
        name: what the run is called: its scenario and seed.
        paced: whether the controller thinks in a thread of its own, and ticks may hold.
        cell, box, library: what it knows of the workcell, the object and the opening's look.
        shape: of the object; a box is opened, anything else is lifted.
        field, carry, until_task: its options.
        loop, gate: limits of the loop and of the safety gate.
    """

    schema: str = "preshape/setup/1"
    name: str
    paced: bool
    cell: Workcell
    box: NominalBox
    library: TextureLibrary
    shape: ShapeName
    field: FieldOptions
    carry: CarryOptions
    until_task: int
    loop: LoopConfig
    gate: GateConfig

    def controller(
        self, perception: Perception, report_opening: Callable[[Opening, Matrix], None] = lambda opening, X: None
    ) -> ProcedureControl:
        """Return a new controller that asks this perception."""
        period_s = 1.0 / self.loop.rate_hz
        if self.shape != "box":
            target, until_task = shaped_object(self.shape, self.box), min(self.until_task, len(LIFT_TASK_NAMES))
            return ObjectLift(self.cell, self.box, target, perception, period_s, self.field, until_task)
        return BoxOpening(
            self.cell, self.box, self.library, perception, period_s, self.field, report_opening, self.carry,
            self.until_task,
        )  # fmt: skip


def setup_of(drawn: Scenario, options: RunOptions) -> ControllerSetup:
    """Return what the controller is given in a drawn scenario."""
    opening, rate_hz = drawn.opening, float(options.loop_rate_hz)
    return ControllerSetup(
        name=f"{drawn.name}, seed {drawn.seed}",
        paced=options.in_real_time,
        cell=workcell(drawn),
        box=nominal_box(drawn),
        library=texture_library(opening.tab_length_m, opening.tab_depth_m),
        shape=drawn.shape,
        field=FieldOptions(norm=options.norm, ties=options.ties, mode=options.field),
        carry=CarryOptions(
            speed=options.carry_speed,
            turn_speed=float(np.deg2rad(options.carry_turn_deg)),
            feed_forward=options.feed_forward,
        ),
        until_task=options.until_task,
        loop=LoopConfig(rate_hz=rate_hz, max_ticks=round(options.time_limit_s * rate_hz)),
        gate=GateConfig.at_rate(rate_hz),
    )


def encode_setup(setup: ControllerSetup) -> bytes:
    """Return it as JSON; every number keeps all its bits."""
    return msgspec.json.encode(setup, enc_hook=plain)


def decode_setup(data: bytes) -> ControllerSetup:
    """Return the setup in JSON data; `msgspec.ValidationError` names what is wrong with it."""
    return msgspec.json.decode(data, type=ControllerSetup, dec_hook=rebuilt)
