"""A planned task as tables on a terminal."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike
from rich.console import Console
from rich.table import Table

from preshape.hal import sah_hand
from preshape.hal.layout import finger_slice
from preshape.hal.transform import Matrix, rpy_angles
from preshape.planner.areas import BlockArea
from preshape.planner.availability import Refusal
from preshape.planner.plan import GraspPlan, PartPlan
from preshape.planner.procedure import SIDE_OF
from preshape.tools.planned_task import PlannedTask


def print_plan(task: PlannedTask, console: Console) -> None:
    """Print priorities, areas, every grasp with its preshape, and what the plan cost."""
    last = task.last.chosen
    console.print(_priorities(task))
    for plan in task.last.parts:
        console.print(_areas(plan, task.areas() if plan is last else plan.areas.blocks))
    for grasp, plan in task.grasps():
        _print_grasp(grasp, plan, console)
    added = [f"{n} {t.name}" for n, t in enumerate(task.tasks(), start=1) if t.regrasps]
    if added:
        console.print("tasks added to make it possible: " + ", ".join(added))
    if last.certificate is not None:
        _print_certificate(last, console)
    console.print("time: " + ", ".join(f"{name.replace('_', ' ')} {ms:.1f} ms" for name, ms in task.time_ms.items()))


def _priorities(planned: PlannedTask) -> Table:
    table = Table(title="priorities, eq. (3)", title_justify="left")
    table.add_column("")
    for number, task in enumerate(planned.tasks(), start=1):
        table.add_column(f"{number} {task.name}", justify="right")
    names = {"r": "right hand", "l": "left hand", "c": "camera"}
    for resource, numbers in planned.priorities().items():
        table.add_row(names[resource], *("*" if n is None else str(n) for n in numbers))
    return table


def _areas(plan: PartPlan, areas: Iterable[BlockArea]) -> Table:
    cuts = " and ".join(f"{cut * 1e3:.1f}" for cut in plan.areas.sections.cuts)
    size = " x ".join(f"{edge * 2e3:.0f}" for edge in plan.part.half)
    title = f"areas on {plan.part.name}, {size} mm, cut at {cuts} mm ({plan.areas.reading})"
    table = Table(title=title, title_justify="left")
    table.add_column("block", no_wrap=True)
    for name in ("p", "patches", "parts", "components"):
        table.add_column(name, justify="right")
    table.add_column("chosen of those usable")
    for area in areas:
        table.add_row(
            str(area.block),
            str(area.priority),
            str(len(area.region)),
            str(len(area.region.parts())),
            str(len(area.components)) if area.block.want == "grasp" else "",
            "" if area.chosen is None else f"{area.chosen}, of {len(area.candidates)}",
        )
    return table


def _print_grasp(grasp: GraspPlan, plan: PartPlan, console: Console) -> None:
    option, ranked = grasp.chosen.option, grasp.chosen
    title = f"{SIDE_OF[grasp.hand]} hand, tasks {grasp.block.first}-{grasp.block.last}: {option} of {plan.part.name}"
    table = Table(title=title, title_justify="left", show_header=False)
    box, preshape = option.box, option.preshape
    table.add_row("preshaping box, object frame", _pose(option.X_object_pb))
    table.add_row("  edges x y z", f"{_mm(2.0 * box.half)} mm, with {box.margin * 1e3:.0f} mm margin on each side of x")
    for finger, p in zip(option.fingers, option.tips_object, strict=True):
        table.add_row(f"fingertip {finger}, object frame", f"{_mm(p)} mm")
    table.add_row("palm, object frame", _pose(option.X_object_palm))
    for finger in sah_hand.FINGERS:
        own = finger_slice(finger)
        joints = ", ".join(f"{np.rad2deg(q):.1f}" for q in option.q_hand[own])
        table.add_row(f"  joints {finger}", f"{joints} deg")
    table.add_row(
        "preshape QP",
        f"{preshape.status.value}, residual {preshape.residual_m * 1e3:.2g} mm, KKT {preshape.kkt_residual:.1g}, "
        f"{preshape.iterations} steps",
    )
    line = f"line {option.closure.line_margin_m * 1e3:.1f} mm inside: {_verdict(option.closure.by_line)}"
    cones = f"friction cones {option.closure.epsilon:.3f}: {_verdict(option.closure.by_cones)}"
    table.add_row("force closure", f"{line}; {cones}")
    table.add_row("clearance, way, hidden", _ranking(ranked.clearance_m, ranked.distance_m, ranked.hidden_share))
    for pose in ranked.poses:
        joints = ", ".join(f"{np.rad2deg(q):.0f}" for q in pose.q_arm)
        face = "" if pose.face is None else f", {pose.face} forward"
        table.add_row(f"arm, {pose.place}{face}", f"{_pose(pose.X_world_palm)}\n{joints} deg, score {pose.score:.0f}")
    console.print(table)
    if len(grasp.options) > 1:
        console.print("  other options: " + "; ".join(str(other.option) for other in grasp.options[1:]))


def _ranking(clearance_m: float, distance_m: float, hidden_share: float) -> str:
    return f"{clearance_m * 1e3:.1f} mm, {distance_m:.2f} m, {hidden_share:.0%} of the search area"


def _print_certificate(plan: PartPlan, console: Console) -> None:
    console.print(f"no plan: {plan.certificate}")
    hand = None if plan.certificate is None else plan.certificate.block.resource
    for reason, options in _by_reason(refusal for refusal in plan.refusals if refusal.hand == hand).items():
        console.print(f"  {reason}: {'; '.join(options)}")


def _by_reason(refusals: Iterable[Refusal]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = defaultdict(list)
    for refusal in refusals:
        found[f"{refusal.place}: {refusal.reason}"].append(refusal.option)
    return found


def _verdict(holds: bool) -> str:
    return "yes" if holds else "no"


def _mm(p: ArrayLike) -> str:
    return ", ".join(f"{value * 1e3:.1f}" for value in np.asarray(p, float))


def _pose(X: Matrix) -> str:
    angles = ", ".join(f"{np.rad2deg(angle):.1f}" for angle in rpy_angles(X[:3, :3]))
    return f"({_mm(X[:3, 3])}) mm, rpy ({angles}) deg"
