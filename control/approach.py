"""The paper's approach: the grouped field brings a hand to a goal fixed to the box, which may move meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from preshape.control.aim import Aim, grasp_aim
from preshape.control.body import Body
from preshape.control.carrier import Carrier
from preshape.control.contact_policy import Phase, Settling, apply_policy
from preshape.control.failure import TaskFailed
from preshape.control.field import Field, FieldOptions, HandGoal, carried_twist, hand_error
from preshape.control.goal_clearance import goal_clearance, goal_error, shorten_ranges
from preshape.control.groups import GROUPS
from preshape.control.motions import Motion, between, eased, limited, ticks
from preshape.control.obstacles import Kind, Obstacles
from preshape.control.sight import Sight
from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.state import Vector
from preshape.hal.tick_record import TickRecord, note_field
from preshape.hal.transform import Matrix, exp_so3, inverse, length, transform
from preshape.hal.world import NominalBox, Opening, OrientedBox, face_normal
from preshape.planner.work_object import WorkObject


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachLimits:
    """Speeds and tolerances of an approach (SI)."""

    speed: float = 0.10
    turn_speed: float = 0.6
    joint_speed: float = 1.2
    preshape_within_m: float = 0.10
    settle_inner_m: float = 0.004
    settle_outer_m: float = 0.020
    position_m: float = 0.0015
    turn_rad: float = 0.015
    joints_rad: float = 0.05
    time_s: float = 12.0
    stall_s: float = 2.5
    stall_m: float = 0.003
    near_m: float = 0.012
    near_rad: float = 0.10


BOX, OPENING = "box", "opening"
"""Names of the bodies that are the object and its face that opens."""
PLATE_M = 0.002
"""Thickness of that face, m."""
READ_AGE_NS = 50_000_000
"""Age from which a reading of the field is no longer shown, ns."""


class FieldGuide:
    """The field of both hands over everything known, kept up to date tick by tick."""

    def __init__(self, body: Body, sight: Sight, box: NominalBox, target: WorkObject, options: FieldOptions) -> None:
        """Register the object's parts as one body, the workcell's static bodies and room for obstacles that appear."""
        self._body, self._sight = body, sight
        self.obstacles = Obstacles(body.links)
        self.obstacles.add(BOX, Kind.OBJECT, target.boxes(np.eye(4)))
        for static in body.cell.statics:
            self.obstacles.add(static.name, Kind.ENVIRONMENT, [static])
        self.field = Field(body.links, self.obstacles, options)
        self.box = box
        self._of_object = [BOX]
        self._known: set[str] = set()
        self._read_ns = -(2**62)
        groups = (len(SIDES), len(GROUPS))
        self._distance, self._point = np.full(groups, np.nan), np.full((*groups, 3), np.nan)
        self._force = np.full((*groups, 3), np.nan)

    def see_opening(self, opening: Opening) -> None:
        """Take a face for the one that opens: a body of its own to the contact policy from then on.

        `ValueError` when one has been taken before.
        """
        normal = face_normal(opening.face)
        half = self.box.size / 2
        plate = np.where(np.abs(normal) > 0.5, PLATE_M / 2, half)
        p = normal * (float(np.abs(normal) @ half) - PLATE_M / 2)
        self.obstacles.add(OPENING, Kind.OPENING, [OrientedBox(OPENING, transform(p), plate)])
        self._of_object.append(OPENING)

    def refresh(self) -> bool:
        """Place the box and all obstacles where they are seen; return whether a new obstacle has appeared."""
        if self._sight.estimate is not None:
            for name in self._of_object:
                self.obstacles.move(name, self._sight.X_world_box)
        new = False
        for obstacle in self._sight.obstacles:
            if obstacle.name not in self._known:
                self._known.add(obstacle.name)
                local = OrientedBox(obstacle.name, np.eye(4), obstacle.half)
                self.obstacles.add(obstacle.name, Kind.ENVIRONMENT, [local])
                new = True
            self.obstacles.move(obstacle.name, obstacle.X_world_box)
        return new

    def read(self) -> None:
        """Keep the last evaluation's distance, reciprocal point and force of each group for telemetry."""
        self._read_ns = self._body.now_ns
        for hand, side in enumerate(SIDES):
            for number, reading in enumerate(self.field.readings(side)):
                near = np.isfinite(reading.distance)
                self._distance[hand, number] = reading.distance if near else np.nan
                self._point[hand, number] = reading.point if near else np.nan
                self._force[hand, number] = reading.force

    def note(self, record: TickRecord) -> None:
        """Write what was read last into a record; NaN when the field has not been read for a while."""
        if self._body.now_ns - self._read_ns <= READ_AGE_NS:
            note_field(record, self._distance, self._point, self._force)
        else:
            note_field(record, np.nan, np.nan, np.nan)


def approach(
    guide: FieldGuide,
    body: Body,
    sight: Sight,
    side: Side,
    X_box_palm: Matrix,
    preshape: Vector,
    carrier: Carrier | None = None,
    limits: ApproachLimits | None = None,
    note: Callable[[str], None] = lambda phase: None,
    aim: Aim | None = None,
) -> Motion:
    """Bring a palm to a pose fixed to the box, its fingers to a preshape, repelled by everything else.

    The twist that a `carrier` commands at the box's centre is fed forward, so the field lives in the box's
    frame. `aim` is what those who watch are told; by default it is derived from the box. `TaskFailed` names a
    stall (no way on for `stall_s`) or the time being up.
    """
    limits = limits or ApproachLimits()
    settling = Settling(limits.settle_inner_m, limits.settle_outer_m)
    body.aims[side] = aim or grasp_aim(side, X_box_palm, preshape, guide.box)
    phase, clearance, goal_box = Phase.APPROACH, None, np.full((4, 4), np.inf)
    best, best_tick, jumps = np.inf, 0, -1
    X_asked = body.asked_palm(side).copy()
    for tick in range(ticks(body, limits.time_s)):
        new_obstacle = guide.refresh()
        X_world_box = sight.X_world_box
        X_led = X_world_box if carrier is None else carrier.ahead(X_world_box)
        goal = HandGoal(X_led @ X_box_palm, preshape)
        moved = carrier is None and float(np.abs(X_world_box - goal_box).max()) > MOVED
        if clearance is None or new_obstacle or moved:
            clearance, goal_box = goal_clearance(guide.field, side, goal), X_world_box
        joints = body.position[LAYOUT.hand(side)]
        X_palm = body.palm(side)
        off = hand_error(goal, X_palm, joints)
        error, position, turn = goal_error(off), length(off.position), length(off.turn)
        if phase is Phase.APPROACH and position < limits.preshape_within_m:
            phase = Phase.PRESHAPE
        settled = settling.update(error) if phase is Phase.PRESHAPE else 0.0
        apply_policy(guide.field.gains, guide.obstacles, side, phase, settled=settled)
        shorten_ranges(guide.field, side, clearance, error)
        guide.field.evaluate()
        if tick % 10 == 0:
            guide.read()
        note(phase.value if settled < 1.0 else Phase.NEAR.value)
        feed = None
        twist_box = carrier.twist if carrier is not None else None
        if twist_box is not None:
            feed = carried_twist(twist_box, X_world_box[:3, 3], X_palm[:3, 3])
        motion = guide.field.motion(side, off, feed)
        X_asked = _advance(X_asked, X_palm, motion.twist, limits, body.period_s)
        body.ask_palm(side, X_asked)
        _ask_fingers(body, side, motion.joints, limits)
        finger_error = float(np.abs(off.joints).max())
        if position < limits.position_m and turn < limits.turn_rad and finger_error < limits.joints_rad:
            return
        jumps_now = sight.estimate.jumps if sight.estimate is not None else 0
        if error < best - limits.stall_m or jumps_now != jumps:
            best, best_tick, jumps = error, tick, jumps_now
        elif (tick - best_tick) * body.period_s > limits.stall_s:
            if position < limits.near_m and turn < limits.near_rad:
                return
            raise TaskFailed(f"stalled: the {side} hand {position * 1e3:.0f} mm from its goal")
        yield
    raise TaskFailed(f"timed out: the {side} hand's approach took more than {limits.time_s:g} s")


def insert(
    guide: FieldGuide,
    body: Body,
    sight: Sight,
    side: Side,
    X_box_palm: Matrix,
    preshape: Vector,
    carrier: Carrier | None = None,
    speed: float = 0.05,
    limits: ApproachLimits | None = None,
    aim: Aim | None = None,
) -> Motion:
    """Lead the palm straight to a pose fixed to the box while the field moves the finger joints alone.

    This is the paper's last part of the second motion: very close to the desired state the reciprocal force
    is applied to the joint angles only. The line is held in the box's frame, so a moving box is followed.
    """
    limits = limits or ApproachLimits()
    X_start = sight.X_world_box if carrier is None else carrier.ahead(sight.X_world_box)
    X_box_start = inverse(X_start) @ body.asked_palm(side)
    distance = length(X_box_palm[:3, 3] - X_box_start[:3, 3])
    count = ticks(body, max(15.0 / 8.0 * distance / speed, 0.3))
    hand = LAYOUT.hand(side)
    body.aims[side] = aim or grasp_aim(side, X_box_palm, preshape, guide.box)
    clearance: Matrix | None = None
    late = 0
    for k in range(1, count + 1):
        guide.refresh()
        X_world_box = sight.X_world_box
        X_led = X_world_box if carrier is None else carrier.ahead(X_world_box)
        body.ask_palm(side, X_led @ between(X_box_start, X_box_palm, eased(k / count)))
        behind = length(body.asked_palm(side)[:3, 3] - body.palm(side)[:3, 3])
        late = late + 1 if behind > FOLLOW_M else 0
        if late * body.period_s > FOLLOW_S:
            raise TaskFailed(f"stalled: the {side} hand {behind * 1e3:.0f} mm beside its way: its arm cannot follow")
        goal = HandGoal(X_world_box @ X_box_palm, preshape)
        if clearance is None:
            clearance = goal_clearance(guide.field, side, goal)
        joints = body.position[hand]
        apply_policy(guide.field.gains, guide.obstacles, side, Phase.NEAR)
        off = hand_error(goal, body.palm(side), joints)
        shorten_ranges(guide.field, side, clearance, goal_error(off))
        guide.field.evaluate()
        if k % 10 == 0:
            guide.read()
        _ask_fingers(body, side, guide.field.motion(side, off).joints, limits)
        yield


MOVED = 0.004
"""An element of the object's pose that has changed by more has moved it: m, or of its rotation."""
FOLLOW_M, FOLLOW_S = 0.012, 0.05
"""A hand that is farther than this from where it is led, for so long, is not inserted any further, m and s."""
LEAD_M = 0.03
"""How far the asked palm may run ahead of the measured one, m."""


def _ask_fingers(body: Body, side: Side, speed: Vector, limits: ApproachLimits) -> None:
    """Ask the fingers to go on for one period at joint speeds (13), rad/s, cut, and within their range."""
    hand = LAYOUT.hand(side)
    speed = np.minimum(np.maximum(speed, -limits.joint_speed), limits.joint_speed)
    fingers = body.asked_fingers(side) + body.period_s * speed
    body.ask_fingers(side, np.minimum(np.maximum(fingers, LAYOUT.lower[hand]), LAYOUT.upper[hand]))


def _advance(X_asked: Matrix, X_measured: Matrix, twist: Matrix, limits: ApproachLimits, dt: float) -> Matrix:
    """Return the asked palm one period on, speeds cut, and kept within a lead of the measured one."""
    v, w = twist[:3], twist[3:]
    v, w = limited(v, limits.speed), limited(w, limits.turn_speed)
    p = X_asked[:3, 3] + v * dt
    offset = p - X_measured[:3, 3]
    p = X_measured[:3, 3] + limited(offset, LEAD_M)
    return transform(p, exp_so3(w * dt) @ X_asked[:3, :3])
