"""Both distances against independent certificates: an LP solver, duality, and facet normals for overlaps."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

from preshape.control.distance_l1 import WORK_L1, pair_l1
from preshape.control.distance_l2 import WORK_L2, pair_l2
from preshape.control.distance_soft import KAPPA, WORK_SOFT, pair_soft
from preshape.control.distances import NORMS, Boxes, PairDistances, pair_distances
from preshape.hal.transform import Matrix, exp_so3


def random_rotation(rng: np.random.Generator) -> Matrix:
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


def _place(kind: int, rng: np.random.Generator, h: Matrix, H: Matrix) -> tuple[Matrix, Matrix]:
    """Return centre and axes of a link box in the obstacle's frame: kinds 0-3 general, 4 parallel, 5 yaw only."""
    if kind < 4:
        return rng.normal(size=3) * rng.choice([0.02, 0.1, 0.5]), random_rotation(rng)
    if kind == 4:
        R = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3)
        reach = H + np.abs(R) @ h
        y, axis = rng.uniform(-1.1, 1.1, 3) * reach, rng.integers(3)
        y[axis] = reach[axis] + rng.choice([0.0, 0.01, -0.002])
        return y, R
    yaw = rng.uniform(0, 2 * np.pi)
    y = np.array([*rng.uniform(-0.5, 0.5, 2), H[2] + h[2] + rng.choice([0.0, 0.01, -0.001])])
    return y, exp_so3([0.0, 0.0, yaw])


def make_pairs(count: int, seed: int) -> tuple[Boxes, Boxes, Matrix]:
    """Boxes of every kind: a third parallel, touching or overlapping, and yaw-only pairs on a table."""
    rng = np.random.default_rng(seed)
    h, H = rng.uniform(0.005, 0.1, (count, 3)), rng.uniform(0.001, 0.3, (count, 3))
    p, R = np.zeros((count, 3)), np.zeros((count, 3, 3))
    P, Q = rng.uniform(-0.5, 0.5, (count, 3)), np.array([random_rotation(rng) for _ in range(count)])
    for i in range(count):
        kind = i % 6
        if kind == 5:
            P[i], Q[i], H[i] = (0.55, 0.0, -0.025), np.eye(3), (0.4, 0.6, 0.025)
        y, R_rel = _place(kind, rng, h[i], H[i])
        p[i], R[i] = P[i] + Q[i] @ y, Q[i] @ R_rel
    links, obstacles = Boxes(p, R, h), Boxes(P, Q, H)
    touching = np.arange(3, count, 6)
    out = measure("l2", links, obstacles)
    p[touching] -= out.distance[touching, None] * out.gradient[touching]
    return links, obstacles, h


def measure(norm, links: Boxes, obstacles: Boxes) -> PairDistances:
    count = len(links.p)
    out = PairDistances.empty(count)
    pair_distances(norm, links, obstacles, np.stack([np.arange(count)] * 2, axis=1), out)
    return out


def relative(links: Boxes, obstacles: Boxes, i: int) -> tuple[Matrix, Matrix]:
    """Return centre y and the six generators (3, 6) of a pair in the obstacle's frame."""
    Q = obstacles.R[i]
    return Q.T @ (links.p[i] - obstacles.p[i]), np.hstack([Q.T @ links.R[i] * links.h[i], np.diag(obstacles.h[i])])


def l1_by_lp(y: Matrix, G: Matrix) -> float:
    A = np.vstack([np.hstack([G, -np.eye(3)]), np.hstack([-G, -np.eye(3)])])
    options = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    bounds = [(-1, 1)] * 6 + [(0, None)] * 3
    cost = np.r_[np.zeros(6), np.ones(3)]
    solved = linprog(cost, A_ub=A, b_ub=np.r_[-y, y], bounds=bounds, method="highs", options=options)
    return float(solved.fun)


def depth_by_normals(y: Matrix, G: Matrix, dual: float) -> float:
    """Least gap to close over all generator cross products, each of unit dual norm."""
    axes = G / np.linalg.norm(G, axis=0)
    depth = np.inf
    for a, b in combinations(range(6), 2):
        n = np.cross(axes[:, a], axes[:, b])
        if np.linalg.norm(n) > 1e-9:
            n = n / np.linalg.norm(n, ord=dual)
            depth = min(depth, float(np.abs(n @ G).sum() - abs(n @ y)))
    return depth


def outside(boxes: Boxes, points: Matrix) -> float:
    return float((np.abs(np.einsum("nij,ni->nj", boxes.R, points - boxes.p)) - boxes.h).max())


def check_l1(count: int, seed: int) -> None:
    links, obstacles, _ = make_pairs(count, seed)
    out = measure("l1", links, obstacles)
    assert outside(links, out.p_link) < 1e-9 and outside(obstacles, out.p_obstacle) < 1e-9
    separation = np.abs(np.einsum("nij,ni->nj", obstacles.R, out.separation)).sum(axis=1)
    np.testing.assert_allclose(separation, np.abs(out.distance), atol=1e-9)
    overlapping = 0
    for i in range(count):
        y, G = relative(links, obstacles, i)
        assert abs(l1_by_lp(y, G) - max(out.distance[i], 0.0)) < 1e-9
        if out.distance[i] <= 0.0:
            overlapping += 1
            assert abs(depth_by_normals(y, G, np.inf) + out.distance[i]) < 1e-9
    assert overlapping > count / 10


def check_l2(count: int, seed: int) -> None:
    links, obstacles, _ = make_pairs(count, seed)
    out = measure("l2", links, obstacles)
    assert outside(links, out.p_link) < 1e-9 and outside(obstacles, out.p_obstacle) < 1e-9
    np.testing.assert_allclose(np.linalg.norm(out.separation, axis=1), np.abs(out.distance), atol=1e-12)
    n = out.gradient
    lower = np.einsum("ni,ni->n", n, links.p - obstacles.p)
    for boxes in (links, obstacles):
        lower -= (np.abs(np.einsum("ni,nij->nj", n, boxes.R)) * boxes.h).sum(axis=1)
    apart = out.distance > 0.0
    assert np.abs(out.distance - lower)[apart].max() <= 1e-7
    for i in np.flatnonzero(~apart):
        y, G = relative(links, obstacles, i)
        assert abs(depth_by_normals(y, G, 2) + out.distance[i]) < 1e-9


def test_l1_equals_the_linear_programme() -> None:
    check_l1(300, 1)


@pytest.mark.slow
def test_l1_equals_the_linear_programme_on_20000_pairs() -> None:
    check_l1(20_000, 2)


def test_l2_is_certified_by_duality() -> None:
    check_l2(3000, 1)


@pytest.mark.slow
def test_l2_is_certified_by_duality_on_20000_pairs() -> None:
    check_l2(20_000, 2)


@pytest.mark.parametrize("norm", NORMS)
def test_gradient_is_the_slope_of_the_distance(norm) -> None:
    links, obstacles, _ = make_pairs(3000, 7)
    general = np.isin(np.arange(3000) % 6, (0, 1, 2))
    out = measure(norm, links, obstacles)
    for axis in np.eye(3):
        ahead = measure(norm, Boxes(links.p + 1e-7 * axis, links.R, links.h), obstacles).distance
        back = measure(norm, Boxes(links.p - 1e-7 * axis, links.R, links.h), obstacles).distance
        errors = np.abs((ahead - back) / 2e-7 - out.gradient @ axis)[general]
        # A kink of the distance inside the step is possible, but rare.
        assert np.mean(errors < 1e-5) > 0.995


@pytest.mark.parametrize("norm", NORMS)
def test_moving_an_overlapping_link_by_minus_its_separation_just_separates(norm) -> None:
    links, obstacles, _ = make_pairs(3000, 8)
    out = measure(norm, links, obstacles)
    deep = out.distance < 0.0
    moved = measure(norm, Boxes(links.p - out.separation, links.R, links.h), obstacles)
    assert deep.sum() > 300
    np.testing.assert_allclose(moved.distance[deep], 0.0, atol=1e-10)


@pytest.mark.parametrize("norm", NORMS)
def test_distance_does_not_depend_on_the_world_frame(norm) -> None:
    rng = np.random.default_rng(3)
    links, obstacles, _ = make_pairs(600, 9)
    R, t = random_rotation(rng), rng.normal(size=3)
    turned = [Boxes(b.p @ R.T + t, R @ b.R, b.h) for b in (links, obstacles)]
    np.testing.assert_allclose(measure(norm, *turned).distance, measure(norm, links, obstacles).distance, atol=1e-12)


def test_parallel_faces_meet_in_the_middle_of_their_overlap() -> None:
    links = Boxes(np.array([[0.0, 0.0, 0.03]]), np.eye(3)[None], np.array([[0.02, 0.03, 0.01]]))
    obstacles = Boxes(np.array([[0.01, 0.0, 0.0]]), np.eye(3)[None], np.array([[0.05, 0.05, 0.01]]))
    for norm in NORMS:
        out = measure(norm, links, obstacles)
        assert out.distance[0] == pytest.approx(0.01, abs=1e-12)
        np.testing.assert_allclose(out.p_link[0], [0.0, 0.0, 0.02], atol=1e-9)
        np.testing.assert_allclose(out.gradient[0], [0.0, 0.0, 1.0], atol=1e-12)


def test_l1_is_never_below_l2_and_at_most_root_three_times_it() -> None:
    links, obstacles, _ = make_pairs(3000, 10)
    l1, l2 = (measure(norm, links, obstacles).distance for norm in NORMS)
    apart = l2 > 0
    assert np.all(l1[apart] >= l2[apart] - 1e-12) and np.all(l1[apart] <= np.sqrt(3) * l2[apart] + 1e-12)


@pytest.mark.parametrize("euclidean", [True, False])
def test_soft_distance_is_a_minimum_close_to_the_exact_one(euclidean) -> None:
    rng = np.random.default_rng(12)
    work, tried = np.zeros(WORK_SOFT), 0
    for _ in range(400):
        y, R = rng.normal(size=3) * 0.1, exp_so3(rng.normal(size=3) * rng.choice([1.0, 1e-3, 1e-6]))
        h, H = rng.uniform(0.01, 0.06, 3), rng.choice([1e-3, 0.02, 0.1], 3)
        a, o, d = np.zeros(3), np.zeros(3), np.zeros(3)
        if euclidean:
            exact = pair_l2(y, R, h, H, np.inf, a, o, d, np.zeros(WORK_L2))
        else:
            exact = pair_l1(y, R, h, H, a, o, d, np.zeros(WORK_L1))
        if exact <= 0.0:
            continue
        tried += 1
        value = pair_soft(euclidean, y, R, h, H, a, d, work)
        u = R.T @ (a - y)
        slope = R.T @ d + KAPPA * u
        free = ~((u >= h - 1e-12) & (slope < 0) | (u <= -h + 1e-12) & (slope > 0))
        assert np.abs(slope[free]).max(initial=0.0) < 1e-6
        assert exact - 1.5e-3 < value < exact + 0.5 * KAPPA * (h @ h) + 1e-3
    assert tried > 150


def test_bad_arguments_are_named() -> None:
    boxes = Boxes(np.zeros((1, 3)), np.eye(3)[None], np.ones((1, 3)))
    with pytest.raises(ValueError, match="l3"):
        pair_distances("l3", boxes, boxes, np.array([[0, 0]]), PairDistances.empty(1))  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="room"):
        pair_distances("l1", boxes, boxes, np.array([[0, 0]]), PairDistances.empty(2))
