"""What the field alone does: `python -m preshape.tools.bench_approach`, a hand from random starts among random posts.

No path is planned and there is no physics: the right hand starts anywhere around its pre-grasp of the standing tea
box, tilted, its fingers anyhow, with posts on the table beside the box, and the field of `control.approach` leads it,
through IK and smoothing, with perfect drives and sight. Every variant of the field gets the same starts. Nothing says
that a start has a way that the field can find: what counts is how the variants differ.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from preshape.control.approach import ApproachLimits, FieldGuide, approach
from preshape.control.body import Body
from preshape.control.distances import Boxes, PairDistances, pair_distances
from preshape.control.failure import TaskFailed
from preshape.control.field import FieldOptions, HandGoal
from preshape.control.goal_clearance import goal_hand_boxes
from preshape.control.grasp_choice import STANDOFF_M, back_off
from preshape.control.grips import cage_grip
from preshape.control.sight import Sight
from preshape.hal.layout import LAYOUT
from preshape.hal.state import RobotState, Vector
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.hal.world import Image, NominalBox, OrientedBox, PoseSample, Workcell
from preshape.planner.arm_ik import solve_palm
from preshape.planner.work_object import box_object
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import initial_box_pose, nominal_box, workcell
from preshape.sim_backend.simulation import home_position

VARIANTS: dict[str, FieldOptions] = {
    "grouped, smooth ties, L2 (default)": FieldOptions(),
    "summed over all boxes": FieldOptions(mode="summed"),
    "hard tie sets": FieldOptions(ties="hard"),
    "L1 distance": FieldOptions(norm="l1"),
}
PERIOD_S = 0.004
ROOM_M = 0.015
"""Least distance of the hand's boxes from everything at the start, and from all but the tea box at the goal, m."""
MOST_POSTS = 6
HAND = LAYOUT.hand("right")


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """One approach to be made: where the box and the posts stand, the goal, and all 40 joints at the start."""

    cell: Workcell
    box: NominalBox
    X_world_box: Matrix
    posts: tuple[OrientedBox, ...]
    X_box_palm: Matrix
    preshape: Vector
    position: Vector


@dataclass(frozen=True, slots=True)
class Flight:
    """How an approach ended (reached, stalled, timed out), how long it took, and the hand's least distance, m."""

    end: str
    seconds: float
    least_m: float


@dataclass(frozen=True, slots=True)
class _Truth:
    """`Perception` that sees box and posts as they are."""

    start: Start

    def object_pose(self, now_ns: int) -> PoseSample:
        """Return the pose now."""
        return PoseSample(now_ns, self.start.X_world_box)

    def obstacles(self, now_ns: int) -> tuple[OrientedBox, ...]:
        """Return the posts."""
        return self.start.posts

    def image(self, now_ns: int) -> Image:
        """Refuse: there is nothing to be looked at."""
        raise NotImplementedError("an approach takes no image")


def draw_start(rng: np.random.Generator, tries: int = 400) -> Start:
    """Draw a start whose hand has room there and at the goal; `RuntimeError` when no try gives one."""
    lower, upper = LAYOUT.lower[HAND], LAYOUT.upper[HAND]
    for _ in range(tries):
        drawn = Scenario(name="approach").drawn(int(rng.integers(2**31)))
        cell, box, X_world_box = workcell(drawn), nominal_box(drawn), initial_box_pose(drawn)
        grip = cage_grip(box.size, "+z", "+y" if rng.random() < 0.5 else "-y", "right")
        X_box_palm = back_off(grip.X_box_palm_insert, STANDOFF_M)
        X_goal = X_world_box @ X_box_palm
        shift = np.array([*rng.uniform(-0.25, 0.25, 2), rng.uniform(-0.05, 0.20)])
        X_start = transform(X_goal[:3, 3] + shift, exp_so3(rng.normal(size=3) * 0.3) @ X_goal[:3, :3])
        fingers = np.clip(grip.preshape + rng.normal(size=13) * 0.3, lower, upper)
        taken = OrientedBox("box", X_world_box, box.size / 2)
        way = X_goal[:2, 3], X_start[:2, 3]
        posts = tuple(_post(rng, *way, number) for number in range(int(rng.integers(1, MOST_POSTS + 1))))
        around = [*cell.statics, *posts]
        if _room(HandGoal(X_goal, grip.preshape), around) < ROOM_M:
            continue
        if _room(HandGoal(X_start, fingers), [taken, *around]) < ROOM_M:
            continue
        base = cell.X_world_base["right"]
        if len(solve_palm("right", base, X_goal)) == 0:
            continue
        postures = solve_palm("right", base, X_start)
        if len(postures) == 0:
            continue
        position = home_position()
        arm = LAYOUT.arm("right")
        position[arm] = postures[int(np.argmin(np.abs(postures - position[arm]).max(axis=1)))]
        position[HAND] = fingers
        return Start(cell, box, X_world_box, posts, X_box_palm, grip.preshape, position)
    raise RuntimeError(f"tries: none of {tries} drew a start with room for the hand")


def _post(rng: np.random.Generator, to: Vector, start: Vector, number: int) -> OrientedBox:
    """Return a post on the table, 0.25 to 0.60 m high, within 0.15 m of the straight way (2,), (2,) between palms."""
    half = np.array([*rng.uniform(0.01, 0.03, 2), rng.uniform(0.125, 0.30)])
    place = to + rng.uniform(0.0, 1.0) * (start - to) + rng.uniform(-0.15, 0.15, 2)
    turned = exp_so3(np.array([0.0, 0.0, rng.uniform(0.0, np.pi)]))
    return OrientedBox(f"post{number}", transform((*place, half[2]), turned), half)


def _room(goal: HandGoal, things: list[OrientedBox]) -> float:
    """Return the least distance of a hand's boxes from everything, m."""
    hand, boxes = goal_hand_boxes("right", goal), Boxes.of(things)
    pairs = np.indices((len(hand.p), len(boxes.p))).reshape(2, -1).T.copy()
    out = PairDistances.empty(len(pairs))
    pair_distances("l2", hand, boxes, pairs, out)
    return float(out.distance.min())


def fly(start: Start, options: FieldOptions, limits: ApproachLimits | None = None) -> Flight:
    """Let the field lead the hand from a start to its goal."""
    body = Body(start.cell, PERIOD_S)
    sight = Sight(_Truth(start), body)
    guide = FieldGuide(body, sight, start.box, box_object(start.box), options)
    position, velocity = start.position.copy(), np.zeros(LAYOUT.dof)
    body.follow(position, velocity)
    still = np.zeros(LAYOUT.dof)
    motion = approach(guide, body, sight, "right", start.X_box_palm, start.preshape, limits=limits)
    end, least, tick = "reached", np.inf, 0
    while True:
        now_ns = round(tick * PERIOD_S * 1e9)
        stamp_ns = np.full(LAYOUT.dof, now_ns)
        body.update(now_ns, RobotState(tick, position, velocity, still, stamp_ns))
        sight.update(now_ns)
        try:
            next(motion)
        except StopIteration:
            break
        except TaskFailed as failed:
            end = failed.kind
            break
        least = min(least, float(guide.field.results.distance[0].min()))
        asked = body.setpoint().position
        velocity = (asked - position) / PERIOD_S
        position = asked.copy()
        tick += 1
    return Flight(end, tick * PERIOD_S, least)


@dataclass(slots=True)
class ApproachBench:
    """What every variant came to, flight by flight, on the same starts."""

    seed: int
    flights: dict[str, list[Flight]] = field(default_factory=dict[str, list[Flight]])

    def lines(self) -> list[str]:
        """Return the report, line by line."""
        count = len(next(iter(self.flights.values())))
        lines = [f"{count} random starts, seed {self.seed}"]
        lines.append(f"{'':36s} reached   touched   stalled  timed out   s, median   p90   least gap, mm, median")
        for name, flights in self.flights.items():
            ends = Counter(flight.end for flight in flights)
            touched = sum(flight.least_m < 0.0 for flight in flights)
            clean = [flight for flight in flights if flight.end == "reached" and flight.least_m >= 0.0]
            seconds = [flight.seconds for flight in clean] or [np.nan]
            gap = float(np.median([1e3 * flight.least_m for flight in clean] or [np.nan]))
            p50, p90 = np.percentile(seconds, [50, 90])
            lines.append(
                f"{name:36s} {len(clean):7d} {touched:9d} {ends['stalled']:9d} {ends['timed out']:10d} {p50:11.2f} "
                f"{p90:5.2f} {gap:24.1f}"
            )
        return [*lines, "reached: without touching anything; seconds and gap are theirs"]


def bench_approach(count: int = 200, seed: int = 5, told: Callable[[int], None] = lambda done: None) -> ApproachBench:
    """Fly all variants from `count` random starts; `told` hears how many are done."""
    rng = np.random.default_rng(seed)
    bench = ApproachBench(seed, {name: [] for name in VARIANTS})
    for number in range(count):
        start = draw_start(rng)
        for name, options in VARIANTS.items():
            bench.flights[name].append(fly(start, options))
        told(number + 1)
    return bench


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m preshape.tools.bench_approach", description=__doc__)
    parser.add_argument("--starts", type=int, default=200, help="random starts; default: %(default)s")
    parser.add_argument("--seed", type=int, default=5, help="of the starts; default: %(default)s")
    options = parser.parse_args()
    if options.starts < 1:
        parser.error(f"--starts: got {options.starts}, allowed is >= 1")

    def told(done: int) -> None:
        if done % 20 == 0:
            print(f"{done} of {options.starts} starts", file=sys.stderr, flush=True)

    print("\n".join(bench_approach(options.starts, options.seed, told).lines()))


if __name__ == "__main__":
    main()
