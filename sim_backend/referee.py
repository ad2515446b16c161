"""The referee: reads only simulator truth, every step, and alone decides whether the procedure was done."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.layout import LAYOUT
from preshape.hal.transform import Matrix, inverse
from preshape.hal.world import FACES, Face
from preshape.sim_backend.clearance import Clearance
from preshape.sim_backend.commanded_palm import CommandedPalm
from preshape.sim_backend.contact_rules import CLASS, SELF, geom_classes, hand
from preshape.sim_backend.contact_scan import LEFT_ON_BOX, RIGHT_ON_BOX, TABLE_ON_BOX, ContactScan
from preshape.sim_backend.hold_slip import HoldSlip, Sustained
from preshape.sim_backend.judged import judged
from preshape.sim_backend.lid_truth import LidTruth
from preshape.sim_backend.referee_report import Contact, TaskTruth, Verdict
from preshape.sim_backend.scene import TIMESTEP_S
from preshape.sim_backend.simulation import Simulation
from preshape.sim_backend.stages import CLEAR_M, Glance, opening_error

TORQUE_TIME_S = 0.010
"""Torque above its bound must last longer than this to count."""
CLEARANCE_PERIOD = 20
"""Steps between two looks at the right hand's distance from the box, while it matters."""
DROP_HEIGHT_M, DROP_TIME_S = 0.010, 0.020
"""A box that no hand has touched for this long, this high above the table, or that low below it, is dropped."""
RETAKE_S = 0.2
"""A new try at the regrasp begins after the taking hand has been off the box for this long."""


class Referee:
    """Watches one simulation from its creation on; `verdict` may be asked at any time.

    Sees contacts, torques and poses of every step. Slip counts from the first lift-off: of the right hand until
    the left has been holding alone, of the left from task 3 on; while both hold, by their share of the load.
    """

    def __init__(self, simulation: Simulation) -> None:
        """Attach to a simulation that has not been stepped yet."""
        self._simulation = simulation
        model, scenario = simulation.model, simulation.scenario
        self._judged = judged(scenario.shape)
        self._contacts = ContactScan(model, scenario, self._judged.rules)
        self._stages = self._judged.stages()
        self._slip = HoldSlip(TIMESTEP_S)
        self._torque = Sustained(LAYOUT.torque, round(TORQUE_TIME_S / TIMESTEP_S) + 1)
        self._panels = Sustained(np.ones(len(FACES)), max(1, round(scenario.strengths.tear_time_s / TIMESTEP_S)))
        self._crush_n = scenario.strengths.crush_n * scenario.strengths.scale
        self._lid = LidTruth(simulation)
        self._max_angles = np.zeros(2)
        self._commanded_palm = CommandedPalm(model, simulation.drives, "right")
        self._clearance = _right_hand_clearance(simulation)
        self._bits = 0
        self._is_clear = False
        self._countdown = 0
        self._untouched_s = 0.0
        self._left_off_s = np.inf
        self._X_palm_box: Matrix | None = None
        self._regrasp_motion_m = 0.0
        self._undesired: list[Contact] = []
        self._self: list[Contact] = []
        simulation.after_step.append(self._look)

    @property
    def stage(self) -> int:
        """Task that the world is truly in, from 1 on (all before it have ended), one more after the last."""
        return self._stages.stage

    @property
    def held(self) -> bool:
        """Whether a hand, and not the table, carries the box at this moment."""
        return bool(self._bits & (RIGHT_ON_BOX | LEFT_ON_BOX)) and not self._bits & TABLE_ON_BOX

    def report_opening(self, face: Face, edge: Face, offset: float, X_world_box: Matrix) -> None:
        """Judge the opening (as `preshape.hal.world.Opening`, offset in m) that the controller says it has found.

        `X_world_box` is the pose the controller believes the box has at this moment.
        """
        simulation, opening = self._simulation, self._simulation.scenario.opening
        error = opening_error(
            simulation.X_world_box,
            (opening.face, opening.edge, opening.offset_m),
            X_world_box,
            (face, edge, offset),
            np.array(simulation.scenario.box.size_m),
            opening.tab_depth_m,
        )
        self._stages.judge_opening(simulation.seconds, error)

    def verdict(self) -> Verdict:
        """Return all that was seen up to now."""
        stages, lid = self._stages, self._lid
        ratios, angles = self._torque.worst, np.rad2deg(lid.angles())
        max_angles = np.rad2deg(self._max_angles)
        events = stages.events
        return Verdict(
            undesired_contacts=tuple(self._undesired),
            self_contacts=tuple(self._self),
            desired_contacts_made={task: event in events for task, event in self._judged.desired.items()},
            dropped="dropped" in events,
            crushed="crushed" in events,
            max_torque_ratio=float(ratios.max()),
            max_torque_joint=LAYOUT.names[int(ratios.argmax())],
            peak_torque_ratio=float(self._torque.peak.max()),
            max_commanded_ratio=self._simulation.drives.max_requested_ratio,
            hold_slip_mm=1e3 * self._slip.slip_m,
            worst_link_slip_mm=1e3 * float(self._slip.path_m.max()),
            regrasp_motion_mm=1e3 * self._regrasp_motion_m,
            max_panel_load_n={face: float(load) for face, load in zip(FACES, self._panels.worst, strict=True)},
            tab_angle_deg=float(angles[0]),
            max_tab_angle_deg=float(max_angles[0]),
            lid_angle_deg=float(angles[1]),
            max_lid_angle_deg=float(max_angles[1]),
            tab_torn=lid.tab_torn,
            torn_fraction=lid.torn_fraction,
            opening_error=stages.opening_error,
            tasks=tuple(self._task(number) for number in self._judged.names),
            events=dict(events),
            until_task=len(self._judged.names),
        )

    def _task(self, number: int) -> TaskTruth:
        events = self._stages.events
        starts = {1: 0.0, 3: events.get("opening_reported")}
        start = starts[number] if number in starts else events.get(f"T{number - 1}")
        return TaskTruth(number, self._judged.names[number], self._stages.done(number), start, events.get(f"T{number}"))

    def _look(self, time_ns: int) -> None:
        simulation, stages, lid = self._simulation, self._stages, self._lid
        seconds = (time_ns - simulation.start_ns) * 1e-9
        self._bits, fresh = self._contacts.scan(simulation.data, stages.stage, lid.shut)
        if len(fresh):
            self._note_contacts(fresh, seconds)
        tab_rad, lid_rad = lid.angles()
        self._max_angles[0], self._max_angles[1] = max(self._max_angles[0], tab_rad), max(self._max_angles[1], lid_rad)
        if stages.waits_for_clearance:
            self._check_clearance()
        stages.update(
            Glance(seconds, self._bits, self._contacts.lowest, lid.tab_torn, tab_rad, lid_rad, self._is_clear)
        )
        self._torque.update(simulation.joint_sensors.true_torque)
        self._watch_load(seconds)
        self._watch_hold(seconds)

    def _watch_load(self, seconds: float) -> None:
        self._panels.update(self._contacts.face_load)
        if "crushed" not in self._stages.events and self._panels.worst.max() > self._crush_n:
            self._stages.events["crushed"] = seconds

    def _watch_hold(self, seconds: float) -> None:
        stages, contacts, bits = self._stages, self._contacts, self._bits
        lifted = "lift_off" in stages.events and not bits & TABLE_ON_BOX
        by_left = lifted and stages.stage >= 3 and self._judged.passed_on
        self._slip.update(contacts.link_load, contacts.link_slide, lifted and stages.stage <= 3, by_left)
        if bits & (RIGHT_ON_BOX | LEFT_ON_BOX):
            self._untouched_s = 0.0
        else:
            self._untouched_s += TIMESTEP_S
            high = contacts.lowest > DROP_HEIGHT_M and self._untouched_s >= DROP_TIME_S
            if "dropped" not in stages.events and (high or contacts.lowest < -DROP_HEIGHT_M):
                stages.events["dropped"] = seconds
        if stages.stage == 3 and self._judged.passed_on:
            self._watch_regrasp(bool(bits & LEFT_ON_BOX))

    def _watch_regrasp(self, left_touches: bool) -> None:
        """Follow the box from the left hand's first touch until the left carries more load.

        It is followed in the frame of the right palm as commanded: what the hand is told to do with the box is taken
        out, what gives way in hand or arm when the other one takes hold is not.
        """
        if not left_touches:
            self._left_off_s += TIMESTEP_S
            return
        X_palm_box = inverse(self._commanded_palm.pose()) @ self._simulation.X_world_box
        if self._left_off_s >= RETAKE_S:
            self._X_palm_box = X_palm_box
        self._left_off_s = 0.0
        right, left = self._slip.grip_load()
        if self._X_palm_box is None or left > right:
            self._X_palm_box = None
            return
        moved = float(np.linalg.norm(X_palm_box[:3, 3] - self._X_palm_box[:3, 3]))
        self._regrasp_motion_m = max(self._regrasp_motion_m, moved)

    def _check_clearance(self) -> None:
        if self._bits & RIGHT_ON_BOX:
            self._is_clear, self._countdown = False, 0
            return
        if self._countdown == 0:
            self._is_clear = self._clearance.exceeds(self._simulation.data, CLEAR_M)
            self._countdown = CLEARANCE_PERIOD
        self._countdown -= 1

    def _note_contacts(self, fresh: NDArray[np.int64], seconds: float) -> None:
        model = self._simulation.model
        for first, second, kind in fresh.tolist():
            names = sorted((model.geom(first).name, model.geom(second).name), key=_link_first)
            (self._self if kind == SELF else self._undesired).append((names[0], names[1], round(seconds, 3)))


def _right_hand_clearance(simulation: Simulation) -> Clearance:
    classes = geom_classes(simulation.model)
    right = np.flatnonzero(np.isin(classes, [CLASS[name] for name in hand("right")]))
    box = np.flatnonzero(np.isin(classes, [CLASS[name] for name in ("shell", "lid", "tab")]))
    return Clearance(simulation.model, right, box)


def _link_first(name: str) -> tuple[bool, str]:
    return not name.startswith(("right_", "left_")), name
