"""What a distance costs: the compiled kernels beside scipy's LP and MuJoCo's own call, in one run."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from preshape.control.distances import NORMS, Boxes, PairDistances, pair_distances
from preshape.hal.transform import Matrix

mujoco: Any = importlib.import_module("mujoco")  # it carries no types

PAIRS = 756
"""36 link boxes against 21 obstacle boxes."""


def random_boxes(count: int, spread: float, rng: np.random.Generator) -> Boxes:
    """Return boxes of a hand's and a workcell's sizes within +-spread (m)."""
    Q, _ = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    R = Q * np.sign(np.linalg.det(Q))[:, None, None]
    return Boxes(rng.uniform(-spread, spread, (count, 3)), np.ascontiguousarray(R), rng.uniform(0.01, 0.07, (count, 3)))


def _median_s(run: Callable[[], object], repeats: int) -> float:
    run()
    times: list[float] = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def _lp_s(links: Boxes, obstacles: Boxes, samples: int) -> float | None:
    """Return seconds per pair of scipy's LP (HiGHS), or None where scipy is not installed (a development tool)."""
    try:
        linprog: Callable[..., Any] = importlib.import_module("scipy.optimize").linprog
    except ImportError:
        return None
    rows: list[tuple[Matrix, Matrix]] = []
    for i in range(samples):
        Q = obstacles.R[i]
        G = np.hstack([Q.T @ links.R[i] * links.h[i], np.diag(obstacles.h[i])])
        y = Q.T @ (links.p[i] - obstacles.p[i])
        rows.append((np.vstack([np.hstack([G, -np.eye(3)]), np.hstack([-G, -np.eye(3)])]), np.r_[-y, y]))
    cost, bounds = np.r_[np.zeros(6), np.ones(3)], [(-1, 1)] * 6 + [(0, None)] * 3

    def solve() -> None:
        for A, b in rows:
            linprog(cost, A_ub=A, b_ub=b, bounds=bounds, method="highs")

    return _median_s(solve, 3) / samples


def _box_model(links: Boxes, obstacles: Boxes) -> tuple[Any, Any]:
    spec = mujoco.MjSpec()
    quat = np.zeros(4)
    for boxes in (links, obstacles):
        for p, R, h in zip(boxes.p, boxes.R, boxes.h, strict=True):
            mujoco.mju_mat2Quat(quat, np.ascontiguousarray(R, dtype=np.float64).ravel())
            body = spec.worldbody.add_body(pos=p, quat=quat)
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=h)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def _mujoco_s(links: Boxes, obstacles: Boxes) -> float:
    """Return seconds per pair of `mj_geomDistance` called from Python."""
    count = len(links.p)
    model, data = _box_model(links, obstacles)
    ends: Matrix = np.zeros(6)

    def ask() -> None:
        for i in range(count):
            mujoco.mj_geomDistance(model, data, i, count + i, 10.0, ends)

    return _median_s(ask, 5) / count


def bench_distances() -> dict[str, float]:
    """Return microseconds per pair of both norms, of the LP and of `mj_geomDistance`, and the ratios to them."""
    rng = np.random.default_rng(0)
    links, obstacles = random_boxes(PAIRS, 0.3, rng), random_boxes(PAIRS, 0.3, rng)
    pairs = np.stack([np.arange(PAIRS)] * 2, axis=1)
    out = PairDistances.empty(PAIRS)
    report: dict[str, float] = {}
    for norm in NORMS:
        seconds = _median_s(lambda norm=norm: pair_distances(norm, links, obstacles, pairs, out), 50)
        report[f"{norm}_us_per_pair"] = seconds / PAIRS * 1e6
    mujoco_us = _mujoco_s(links, obstacles) * 1e6
    lp = _lp_s(links, obstacles, 40)
    report["mj_geomDistance_us_per_pair"] = mujoco_us
    for norm in NORMS:
        report[f"mj_geomDistance_over_{norm}"] = mujoco_us / report[f"{norm}_us_per_pair"]
    if lp is not None:
        report["scipy_lp_us_per_pair"] = lp * 1e6
        report["scipy_lp_over_l1"] = lp * 1e6 / report["l1_us_per_pair"]
    return report


if __name__ == "__main__":
    for name, value in bench_distances().items():
        print(f"{name:32s} {value:12.2f}")
