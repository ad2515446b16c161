"""The preshape QP on random boxes: how many of the reachable ones are solved, how well and how fast."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass

import numpy as np

from preshape.hal.layout import SIDES
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.preshape_qp import PreshapeProblem, PreshapeResult, descend_from, solve, start_at

REACHED_M = 1e-4
"""A box is reachable when any start gets all its fingertips this close, m."""

SOLVED_M = 5e-4
"""A solve counts when its fingertips are this close, m."""


@dataclass(frozen=True, slots=True)
class Row:
    """One random box: whether it is reachable, what the solve reached, and how long it took."""

    reachable: bool
    residual_m: float
    kkt_residual: float
    joint_excess_rad: float
    iterations: int
    starts: int
    fingers: int
    time_s: float


def random_problem(rng: np.random.Generator) -> PreshapeProblem:
    """Draw a box and a hand.

    Preshape faces 5 to 260 mm apart, width 15 to 150 mm, depth of the fingertips 5 to 40 mm; right or left hand;
    any pose of the box; nominal joints anywhere within the limits; fingers by the box's size; default weights,
    standoff and tilt of `PreshapeProblem`.
    """
    half = rng.uniform([0.005, 0.015, 0.010], [0.260, 0.150, 0.080]) / 2.0
    side = SIDES[int(rng.integers(2))]
    k = hand_kinematics(side)
    X_world_pb = transform(rng.uniform(-0.5, 0.5, 3), exp_so3(rng.uniform(0.0, np.pi) * _unit(rng.normal(size=3))))
    return PreshapeProblem(side, X_world_pb, half, rng.uniform(k.lower, k.upper))


def _unit(v: Matrix) -> Matrix:
    return v / np.linalg.norm(v)


def random_start(problem: PreshapeProblem, rng: np.random.Generator) -> Matrix:
    """Draw a start d (19,): any joints, any tilt within bounds, the palm about where the fingers straddle the box."""
    k = problem.kinematics
    start = start_at(problem, rng.uniform(k.lower, k.upper))
    start[:3] += rng.normal(scale=0.02, size=3)
    start[3:6] = rng.uniform(-problem.tilt_max_rad, problem.tilt_max_rad, 3)
    return start


def reachable(problem: PreshapeProblem, rng: np.random.Generator, starts: int) -> bool:
    """Return whether any of so many random-start solves gets below `REACHED_M`."""
    return any(descend_from(problem, random_start(problem, rng))[1].residual < REACHED_M for _ in range(starts))


def fingertip_error(problem: PreshapeProblem, result: PreshapeResult) -> float:
    """Return the worst distance of a fingertip from its target, by forward kinematics of the result alone, m."""
    tips = problem.kinematics.tips(result.joints)[0][: len(problem.fingers)]
    in_world = tips @ result.X_world_palm[:3, :3].T + result.X_world_palm[:3, 3]
    wanted = problem.targets @ problem.X_world_pb[:3, :3].T + problem.X_world_pb[:3, 3]
    return float(np.linalg.norm(in_world - wanted, axis=1).max())


def bench_row(problem: PreshapeProblem, rng: np.random.Generator, starts: int) -> Row:
    """Solve one problem, timed, and find out whether it is reachable."""
    begin = time.perf_counter()
    result = solve(problem)
    elapsed = time.perf_counter() - begin
    k, error = problem.kinematics, fingertip_error(problem, result)
    excess = float(np.maximum(result.joints - k.upper, k.lower - result.joints).max())
    return Row(
        error < REACHED_M or reachable(problem, rng, starts),
        error,
        result.kkt_residual,
        max(0.0, excess),
        result.iterations,
        result.starts,
        len(problem.fingers),
        elapsed,
    )


def bench_preshape(boxes: int = 1000, random_starts: int = 50, seed: int = 7) -> dict[str, float]:
    """Return the figures of one run: shares of the reachable boxes solved, worst residuals, times in ms.

    One solve before the run loads the compiled code and is not counted.
    """
    rng = np.random.default_rng(seed)
    solve(random_problem(rng))
    rows = [bench_row(random_problem(rng), rng, random_starts) for _ in range(boxes)]
    inside = [row for row in rows if row.reachable]
    solved = [row for row in inside if row.residual_m <= SOLVED_M]
    times = np.array([row.time_s for row in rows]) * 1e3
    return {
        "boxes": boxes,
        "reachable": len(inside),
        "solved_share": len(solved) / max(1, len(inside)),
        "kkt_share": sum(row.kkt_residual < 1e-4 for row in solved) / max(1, len(solved)),
        "worst_residual_mm": max((row.residual_m for row in solved), default=0.0) * 1e3,
        "worst_kkt": max((row.kkt_residual for row in solved), default=0.0),
        "joint_excess_rad": max((row.joint_excess_rad for row in rows), default=0.0),
        "first_start_share": sum(row.starts == 1 for row in solved) / max(1, len(solved)),
        "median_iterations": float(np.median([row.iterations for row in solved])) if solved else 0.0,
        "median_ms": float(np.median(times)),
        "median_reachable_ms": float(np.median([row.time_s for row in inside])) * 1e3 if inside else 0.0,
        "p99_ms": float(np.percentile(times, 99)),
    }


if __name__ == "__main__":
    print(json.dumps(bench_preshape(), indent=1))
