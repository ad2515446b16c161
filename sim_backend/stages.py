"""The predicates of the opening on true events: which task the world is in, and when each was truly done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from preshape.hal.transform import Matrix, cross, log_so3
from preshape.hal.world import Face, face_normal
from preshape.sim_backend.contact_scan import (
    FINGER_OUTSIDE,
    LEFT_ON_BOX,
    OTHER_ON_BOX,
    RIGHT_ON_BOX,
    RIGHT_ON_LID,
    TABLE_ON_BOX,
    THUMB_INSIDE,
    THUMB_ON_TAB,
)

LIFT_M = 0.050
OPENING_M, OPENING_RAD = 0.010, np.deg2rad(5.0)
LEFT_ALONE_S = 0.5
TAB_PUSHED_RAD = np.deg2rad(30.0)
CLEAR_M, CLEAR_S = 0.030, 0.2
LID_OPEN_RAD = np.deg2rad(60.0)
LID_OPEN_S = 0.5
PINCH_GAP_S = 0.010
"""Thumb and finger touch the lid at once if their last touches are no further apart than this."""
_ANYONE = RIGHT_ON_BOX | LEFT_ON_BOX | TABLE_ON_BOX | OTHER_ON_BOX


@dataclass(slots=True)
class Glance:
    """What one step showed: touch bits of `contact_scan`, shell height, tab and lid, seconds since the start.

    `is_clear` tells whether the right hand is `CLEAR_M` away from the box; it is asked for only while task 4 waits.
    """

    seconds: float
    bits: int
    lowest: float
    tab_torn: bool
    tab_rad: float
    lid_rad: float
    is_clear: bool


class Stages:
    """Walks from stage 1 to 6 on true events; `events` maps each event to its time, s."""

    def __init__(self) -> None:
        self.stage = 1
        self.events: dict[str, float] = {}
        self.opening_error: tuple[float, float] | None = None
        self._since: dict[str, float] = {}
        self._thumb_s = self._finger_s = -np.inf

    @property
    def waits_for_clearance(self) -> bool:
        """Whether task 4 only waits for the right hand to be clear of the box."""
        return self.stage == 4 and "tab_pushed" in self.events

    def done(self, task: int) -> bool:
        """Whether a task's predicate has come true."""
        return f"T{task}" in self.events

    def judge_opening(self, seconds: float, error: tuple[float, float]) -> None:
        """Take the error (m, rad) of a reported opening; the last report before task 3 is done counts."""
        if self.done(3):
            return
        self.opening_error = error
        self.events.setdefault("opening_reported", seconds)
        if error[0] <= OPENING_M and error[1] <= OPENING_RAD:
            self.events["T2"] = seconds
        else:
            self.events.pop("T2", None)

    def update(self, glance: Glance) -> None:
        """Take one step."""
        self._note_firsts(glance)
        self.walk(glance)

    def walk(self, glance: Glance) -> None:
        """Go to the next stage if its predicate has come true."""
        now, bits = glance.seconds, glance.bits
        if self.stage == 1 and bits & _ANYONE == RIGHT_ON_BOX and glance.lowest >= LIFT_M:
            self.reach("T1", 2, now)
        if self.stage == 2 and "opening_reported" in self.events:
            self.stage = 3
        if self.stage == 3 and self.lasts("left_alone", bits & _ANYONE == LEFT_ON_BOX, now, LEFT_ALONE_S):
            self.reach("T3", 4, now)
        if self.stage == 4:
            if glance.tab_torn and glance.tab_rad >= TAB_PUSHED_RAD:
                self.events.setdefault("tab_pushed", now)
            is_clear = "tab_pushed" in self.events and glance.is_clear
            if self.lasts("clear", is_clear, now, CLEAR_S):
                self.reach("T4", 5, now)
        if self.stage == 5:
            self._watch_lid(glance)

    def _watch_lid(self, glance: Glance) -> None:
        now, bits = glance.seconds, glance.bits
        if bits & THUMB_INSIDE:
            self._thumb_s = now
        if bits & FINGER_OUTSIDE:
            self._finger_s = now
        if abs(self._thumb_s - self._finger_s) <= PINCH_GAP_S:
            self.events.setdefault("pinched", now)
        released = "pinched" in self.events and not bits & (RIGHT_ON_BOX | RIGHT_ON_LID)
        if self.lasts("lid_open", released and glance.lid_rad >= LID_OPEN_RAD, now, LID_OPEN_S):
            self.reach("T5", 6, now)

    def _note_firsts(self, glance: Glance) -> None:
        events, now, bits = self.events, glance.seconds, glance.bits
        if "right_touch" not in events and bits & RIGHT_ON_BOX:
            events["right_touch"] = now
        if "lift_off" not in events and bits & RIGHT_ON_BOX and not bits & TABLE_ON_BOX:
            events["lift_off"] = now
        if "left_touch" not in events and bits & LEFT_ON_BOX:
            events["left_touch"] = now
        if "tab_touch" not in events and bits & THUMB_ON_TAB:
            events["tab_touch"] = now
        if "tab_torn" not in events and glance.tab_torn:
            events["tab_torn"] = now

    def reach(self, event: str, stage: int, now: float) -> None:
        """Note an event and enter a stage."""
        self.events.setdefault(event, now)
        self.stage = stage

    def lasts(self, name: str, holds: bool, now: float, duration_s: float) -> bool:
        """Tell whether a condition has held without a break for a duration."""
        if not holds:
            self._since.pop(name, None)
            return False
        return now - self._since.setdefault(name, now) >= duration_s - 1e-9


def opening_error(
    X_world_true: Matrix, true: tuple[Face, Face, float], X_world_told: Matrix, told: tuple[Face, Face, float],
    size: Matrix, tab_depth: float,
) -> tuple[float, float]:  # fmt: skip
    """Return how far (m) and how turned (rad) a reported tab is from the true one, both placed in the world.

    An opening is (face, edge, offset); its frame has the tab's centre as origin, x towards the edge, z outward.
    """
    X_true = X_world_true @ opening_frame(size, *true, tab_depth)
    X_told = X_world_told @ opening_frame(size, *told, tab_depth)
    turn = log_so3(X_true[:3, :3].T @ X_told[:3, :3])
    return float(np.linalg.norm(X_true[:3, 3] - X_told[:3, 3])), float(np.linalg.norm(turn))


def opening_frame(size: Matrix, face: Face, edge: Face, offset: float, tab_depth: float) -> Matrix:
    """Return X_box_tab of an opening: origin at the tab's centre on the face, x towards its edge, z outward."""
    normal, towards = face_normal(face), face_normal(edge)
    half = size / 2
    along = np.eye(3)[int(np.argmax(size))]
    X = np.eye(4)
    X[:3, :3] = np.column_stack([towards, cross(normal, towards), normal])
    X[:3, 3] = normal * (np.abs(normal) @ half) + towards * (np.abs(towards) @ half - tab_depth / 2) + along * offset
    return X
