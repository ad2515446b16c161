"""Laws of eq. (4)-(5): exact derivatives, the printed step as the first one, honest answers."""

import daqp
import numpy as np
import pytest
from scipy.optimize import lsq_linear

from preshape.hal.layout import SIDES, Side
from preshape.hal.transform import Matrix, exp_so3, inverse, log_so3, transform
from preshape.planner.bounded_qp import solve_bounded_qp
from preshape.planner.hand_kinematics import hand_kinematics
from preshape.planner.postures import PRESHAPE, STRAIGHT
from preshape.planner.preshape_constraint import Nominal, constraint_curvature, tip_constraint
from preshape.planner.preshape_qp import (
    SOLVED_RESIDUAL,
    UNIT_WEIGHTS,
    PreshapeProblem,
    PreshapeResult,
    PreshapeStatus,
    PreshapeWeights,
    linearised,
    nominal_step,
    paper_step,
    solve,
)
from preshape.tools.bench_preshape import bench_preshape, fingertip_error, random_problem

TEA_BOX = np.array([0.042, 0.045, 1 / 30])


def _tea_box(weights: PreshapeWeights) -> PreshapeProblem:
    return PreshapeProblem("right", np.eye(4), TEA_BOX, PRESHAPE, weights=weights)


def _evaluate(side: Side, nominal: Nominal, d: Matrix) -> tuple[Matrix, Matrix, tuple[Matrix, ...]]:
    work = np.empty((18, 3, 3)), np.empty((18, 3)), np.empty((4, 3)), np.empty((4, 3, 13))
    c, A = np.empty(nominal.targets.size), np.empty((nominal.targets.size, 19))
    tip_constraint(hand_kinematics(side).tables, nominal, d, *work, c, A)
    return c, A, work


def _random_nominal(side: Side, rng: np.random.Generator) -> Nominal:
    k = hand_kinematics(side)
    fingers, targets = np.array([0, 1, 3]), rng.normal(size=(3, 3))
    return Nominal(exp_so3(rng.normal(size=3)), rng.normal(size=3), rng.uniform(k.lower, k.upper), fingers, targets)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-3, 0.5, 1.5])
def test_jacobian_and_curvature_equal_finite_differences(side: Side, size: float) -> None:
    rng, e = np.random.default_rng(5), 1e-6
    for _ in range(3):
        nominal, d = _random_nominal(side, rng), rng.normal(size=19) * size
        _, A, work = _evaluate(side, nominal, d)
        steps = [(_evaluate(side, nominal, d + e * v), _evaluate(side, nominal, d - e * v)) for v in np.eye(19)]
        numeric = np.column_stack([(after[0] - before[0]) / (2 * e) for after, before in steps])
        np.testing.assert_allclose(A, numeric, atol=1e-8)
        force, H = rng.normal(size=9), np.empty((19, 19))
        constraint_curvature(hand_kinematics(side).tables, nominal, d, *work, force, H)
        curved = np.column_stack([force @ (after[1] - before[1]) / (2 * e) for after, before in steps])
        np.testing.assert_allclose(H, curved, atol=1e-7)


def test_bounded_qp_equals_daqp() -> None:
    rng = np.random.default_rng(6)
    for _ in range(200):
        n = int(rng.integers(2, 20))
        B = rng.normal(size=(n // 2 + 1, n))
        G, g = np.eye(n) + 10 ** rng.uniform(-2, 3) * B.T @ B, rng.normal(size=n) * 5
        lower, upper = -rng.uniform(0, 1, n) * (rng.random(n) < 0.8), rng.uniform(0, 1, n)
        x = np.zeros(n)
        assert solve_bounded_qp(G, g, lower, upper, x) == 1
        reference = daqp.solve(G, g, np.zeros((0, n)), upper, lower, np.zeros(n, np.int32))[0]
        np.testing.assert_allclose(x, reference, atol=1e-6)


def test_bounded_qp_reports_a_program_that_is_not_convex() -> None:
    assert solve_bounded_qp(-np.eye(3), np.ones(3), -np.ones(3), np.ones(3), np.zeros(3)) == -1


@pytest.mark.parametrize("side", SIDES)
def test_one_step_with_unit_weights_is_the_papers_eq_5(side: Side) -> None:
    rng, found = np.random.default_rng(7), 0
    k = hand_kinematics(side)
    for _ in range(120):
        half = rng.uniform([0.02, 0.015, 0.01], [0.06, 0.07, 0.04])
        q, anywhere = rng.uniform(k.lower, k.upper), (-1.0, 1.0)
        problem = PreshapeProblem(side, np.eye(4), half, q, (), UNIT_WEIGHTS, anywhere, tilt_max_rad=3.0)
        printed, d = paper_step(problem), nominal_step(problem)
        if printed is None:
            continue
        found += 1
        A, b = linearised(problem)
        lower, upper = problem.bounds()
        np.testing.assert_allclose(A @ printed, b, atol=1e-6)
        assert np.all(printed >= lower - 1e-6) and np.all(printed <= upper + 1e-6)
        np.testing.assert_allclose(d, printed, atol=1e-6)
    assert found > 20


def test_heavier_weights_keep_the_palm_closer_to_the_boxs_axes() -> None:
    tilts = [
        np.linalg.norm(log_so3(solve(_tea_box(PreshapeWeights(rotation=weight))).X_pb_palm[:3, :3]))
        for weight in (0.5, 1.0, 2.0, 4.0)
    ]
    assert all(heavier < lighter for lighter, heavier in zip(tilts, tilts[1:], strict=False))


def _independent_kkt(problem: PreshapeProblem, result: PreshapeResult) -> float:
    """Return the least |W^-1 (W^2 d + A'y + mu)| over all y and bound multipliers mu of the right sign, scaled."""
    d = np.concatenate(
        [result.X_pb_palm[:3, 3], log_so3(result.X_pb_palm[:3, :3]), result.joints - problem.nominal_joints]
    )
    _, A, _ = _evaluate(problem.side, problem.nominal(), d)
    W, (lower, upper) = problem.weights.vector(), problem.bounds()
    at_lower, at_upper = np.flatnonzero(d <= lower + 1e-9), np.flatnonzero(d >= upper - 1e-9)
    columns = np.hstack([A.T / W[:, None] / 0.28, -np.eye(19)[:, at_lower], np.eye(19)[:, at_upper]])
    least = np.concatenate([np.full(len(A), -np.inf), np.zeros(len(at_lower) + len(at_upper))])
    fit = lsq_linear(columns, -W * d, (least, np.inf), method="bvls", tol=1e-14)
    pulls = np.abs(columns[:, : len(A)] @ fit.x[: len(A)])
    return float(np.abs(fit.fun).max() / max(1.0, np.abs(W * d).max(), pulls.max()))


def test_solutions_reach_within_limits_at_a_kkt_point() -> None:
    rng, solved = np.random.default_rng(8), 0
    for _ in range(60):
        problem = random_problem(rng)
        result = solve(problem)
        k = problem.kinematics
        assert np.all(result.joints >= k.lower) and np.all(result.joints <= k.upper)
        assert fingertip_error(problem, result) == pytest.approx(result.residual_m, abs=1e-9)
        assert result.reached == (result.residual_m <= SOLVED_RESIDUAL)
        if result.status is PreshapeStatus.SOLVED:
            solved += 1
            assert _independent_kkt(problem, result) < 1e-4
    assert solved > 20


def test_solve_is_deterministic_and_moves_with_the_box() -> None:
    rng = np.random.default_rng(9)
    for _ in range(10):
        X = transform(rng.normal(size=3), exp_so3(rng.normal(size=3)))
        here = solve(PreshapeProblem("right", np.eye(4), TEA_BOX, PRESHAPE))
        there = solve(PreshapeProblem("right", X, TEA_BOX, PRESHAPE))
        np.testing.assert_array_equal(here.joints, there.joints)
        np.testing.assert_allclose(inverse(X) @ there.X_world_palm, here.X_world_palm, atol=1e-12)


def test_left_hand_finds_the_mirror_image() -> None:
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    for posture in (PRESHAPE, STRAIGHT):
        right, left = (solve(PreshapeProblem(side, np.eye(4), TEA_BOX, posture)) for side in SIDES)
        np.testing.assert_allclose(left.joints, right.joints, atol=1e-5)
        np.testing.assert_allclose(left.X_world_palm, mirror @ right.X_world_palm @ mirror, atol=1e-5)


@pytest.mark.parametrize("palm", [(0.2, 0.21), (0.186, 0.4)])
def test_palm_keeps_its_standoff(palm: tuple[float, float]) -> None:
    result = solve(PreshapeProblem("right", np.eye(4), TEA_BOX, PRESHAPE, standoff_m=palm))
    assert result.status is PreshapeStatus.SOLVED
    distance = -TEA_BOX[2] - result.X_pb_palm[2, 3]
    assert palm[0] - 1e-9 <= distance <= palm[1] + 1e-9


def test_what_no_hand_reaches_is_reported_with_its_residual() -> None:
    result = solve(PreshapeProblem("right", np.eye(4), np.array([0.15, 0.045, 0.03]), PRESHAPE))
    assert result.status is PreshapeStatus.UNREACHABLE
    assert not result.reached
    assert result.residual_m > 0.01


def test_bad_problems_are_refused_with_the_field() -> None:
    with pytest.raises(ValueError, match="nominal_joints"):
        PreshapeProblem("right", np.eye(4), TEA_BOX, np.zeros(12))
    with pytest.raises(ValueError, match="half"):
        PreshapeProblem("right", np.eye(4), np.array([np.nan, 1, 1]), PRESHAPE)
    with pytest.raises(ValueError, match="standoff_m"):
        PreshapeProblem("right", np.eye(4), TEA_BOX, PRESHAPE, standoff_m=(0.3, 0.2))
    with pytest.raises(ValueError, match="length_m"):
        PreshapeWeights(length_m=0.0)


@pytest.mark.slow
def test_nearly_all_reachable_random_boxes_are_solved() -> None:
    figures = bench_preshape(boxes=300, seed=17)
    assert figures["reachable"] > 100
    assert figures["solved_share"] >= 0.99
    assert figures["kkt_share"] >= 0.99
    assert figures["joint_excess_rad"] == 0.0
