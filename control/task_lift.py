"""An object of any parts is taken by a grip that the planner chooses, lifted straight up, and held."""

from __future__ import annotations

from dataclasses import dataclass, replace

from preshape.control.aim import Aim, tips_of
from preshape.control.approach import FieldGuide, approach, insert
from preshape.control.failure import TaskFailed
from preshape.control.grasp_choice import PREGRASP_M, STANDOFF_M
from preshape.control.grip import Grip
from preshape.control.motions import Motion, lead_fingers, lead_palm, ticks, wait, wait_for
from preshape.control.planned_grip import planned_grip
from preshape.control.resting import rested
from preshape.control.task_grasp import while_it_stays
from preshape.control.work import Work
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix, inverse, raised, transform
from preshape.planner.arm_capsules import HeldBox
from preshape.planner.option_choice import RankedOption
from preshape.planner.plan import make_plan
from preshape.planner.plan_scene import LIFT_M, PlanScene
from preshape.planner.procedure import LIFT_PROCEDURE

LIFT_SPEED = 0.08
"""Peak speed of the lift, m/s."""
HOLD_S = 1.5
"""How long the lifted object is held, s."""


@dataclass(frozen=True, slots=True, eq=False)
class LiftChoice:
    """An option of the plan as a grip, and the right arm's postures before it, at it and lifted."""

    option: RankedOption
    grip: Grip
    pregrasp: Vector
    grasp: Vector
    lift: Vector

    @property
    def aim(self) -> Aim:
        """What the hand is on its way to."""
        option = self.option.option
        return Aim(
            tips_of(option.side, option.X_object_palm, option.q_hand),
            replace(option.box, X_object_pb=option.X_object_pb),
        )


def before(grip: Grip, X_palm: Matrix, distance: float) -> Matrix:
    """Return a palm pose moved back, against the direction in which the grip's hand comes."""
    return X_palm @ transform(-distance * grip.advance)


def settle_on_table(work: Work) -> Motion:
    """Wait until the object is seen well; then let the table correct the height and the tilt of what is seen."""
    work.phase = "look"
    if not (yield from wait_for(work.body, lambda: work.sight.settled, 3.0)):
        raise TaskFailed("unseen: no settled estimate of the object within 3 s")
    yield from wait(work.body, 0.3)
    work.sight.correct(work.body.now_ns, rested(work.sight.X_world_box, work.box.size, work.cell.table_height))


def choose_lift(work: Work) -> LiftChoice:
    """Return the planner's best option through which the arm has postures near each other; `TaskFailed` if none."""
    scene = PlanScene(
        work.cell, work.target, work.sight.X_world_box, obstacles=work.sight.obstacles, q_arms=work.body.asked_arms()
    )
    plan = make_plan(scene, LIFT_PROCEDURE)
    if plan.certificate is not None:
        raise TaskFailed(f"unreachable: no plan: {plan.certificate}")
    causes: list[str] = []
    for ranked in plan.options("r", 1):
        choice = _postures(work, ranked)
        if isinstance(choice, LiftChoice):
            work.plan = plan.taking("r", 1, ranked)
            work.notes.append(f"grip: {ranked.option} of {ranked.option.part.name}")
            return choice
        causes.append(f"{ranked.option}: {choice}")
    raise TaskFailed("unreachable: " + "; ".join(causes))


def _postures(work: Work, ranked: RankedOption) -> LiftChoice | str:
    """Return the arm's chain of postures for one option, each near the one before, or what is out of reach."""
    grip = planned_grip(ranked.option)
    X_grasp = work.sight.X_world_box @ grip.X_box_palm
    held = HeldBox("right", inverse(grip.X_box_palm), work.box.size / 2)
    poses = {
        "pre-grasp": (before(grip, X_grasp, PREGRASP_M), work.collision()),
        "grasp": (X_grasp, work.collision(exempt=(("right_hand", "box"),))),
        "lift": (raised(X_grasp, LIFT_M), work.collision(held=held)),
    }
    near = work.body.asked_arm("right")
    postures: list[Vector] = []
    for name, (X, model) in poses.items():
        q = work.posture("right", X, model, near)
        if q is None:
            return f"{name} pose out of reach"
        postures.append(q)
        near = q
    return LiftChoice(ranked, grip, *postures)


def come_to(work: Work, guide: FieldGuide, choice: LiftChoice) -> Motion:
    """Travel to the pre-grasp, let the field bring the hand before the object, and lead it around."""
    grip, body = choice.grip, work.body

    def note(phase: str) -> None:
        work.phase = phase

    work.phase = "travel"
    yield from lead_fingers(body, "right", grip.preshape)
    yield from work.travel("right", choice.pregrasp)
    body.prefer_posture("right", choice.grasp)
    X_standoff, aim = before(grip, grip.X_box_palm, STANDOFF_M), choice.aim
    yield from approach(guide, body, work.sight, "right", X_standoff, grip.preshape, note=note, aim=aim)
    work.phase = "insert"
    yield from insert(guide, body, work.sight, "right", grip.X_box_palm, grip.preshape, aim=aim)


def lift_object(work: Work, guide: FieldGuide) -> Motion:
    """Look, plan, approach, close and lift; the grip is kept in `work.grips`."""
    yield from settle_on_table(work)
    choice = choose_lift(work)
    grip, body = choice.grip, work.body
    work.grips["right"] = grip
    yield from while_it_stays(work, come_to(work, guide, choice))
    work.phase = "close"
    yield from work.hands["right"].close(grip)
    work.sight.hold("right")
    work.phase = "lift"
    body.prefer_posture("right", choice.lift)
    yield from lead_palm(body, "right", raised(body.asked_palm("right"), LIFT_M), speed=LIFT_SPEED)
    work.hands["right"].check()


def hold_object(work: Work) -> Motion:
    """Keep the lifted object still; `TaskFailed` as soon as the hand no longer holds it."""
    work.phase = "hold"
    for _ in range(ticks(work.body, HOLD_S)):
        work.hands["right"].check()
        yield
