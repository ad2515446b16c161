"""Hand pose and joints that put the fingertips where a preshaping box wants them (section III-D, eq. (4)-(5))."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from itertools import product
from typing import cast

import daqp
import numpy as np
from numpy.typing import ArrayLike

from preshape.hal import sah_hand
from preshape.hal.layout import HAND_DOF, Side
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.planner.finger_count import fingers_for, tip_targets
from preshape.planner.hand_kinematics import HandKinematics, hand_kinematics
from preshape.planner.postures import START_POSTURES, WIDE_POSTURES, WIDE_YAWS
from preshape.planner.preshape_constraint import STATE_DOF, Nominal, tip_constraint
from preshape.planner.preshape_polish import polish
from preshape.planner.preshape_sqp import RHO, Limits, Outcome, descend, quadratic_step

HAND_LENGTH = 0.28
"""Palm origin to the tip of a straight finger, m: a palm turned by 1 rad moves its fingertips by about this."""

STANDOFF = (0.186, 0.400)
"""Default range of the palm origin's distance from the object's palm face, m: finger bases reach to 0.171."""

SOLVED_RESIDUAL = 1e-4
"""Fingertip error up to which a preshape counts as solved, m."""

SOLVED_KKT = 1e-5
"""Scaled KKT residual up to which a preshape counts as solved."""

LONG = 300
"""Steps granted to the rare solve that creeps past a flat stretch of the cost."""

NEAR = 5e-4
"""Fingertip error up to which an answer that is not yet a KKT point is worth polishing, m."""

CLOSE = 5e-3
"""Fingertip error of all usual starts above which a box is given up, m."""


class PreshapeStatus(Enum):
    """How a solve ended."""

    SOLVED = "solved"
    """Fingertips within `SOLVED_RESIDUAL`, at a KKT point of eq. (5) with eq. (4) not linearised."""
    NOT_OPTIMAL = "not optimal"
    """Fingertips within `SOLVED_RESIDUAL`; the distance from the nominal state may not be the least."""
    UNREACHABLE = "unreachable"
    """No start reached the fingertip positions; `residual_m` says by how much the best one misses."""


@dataclass(frozen=True, slots=True)
class PreshapeWeights:
    """What a displacement from the nominal state costs: |u / length|^2 + |rotation phi|^2 + |joints dq|^2.

    `length_m` makes metres commensurate with radians; the two factors are dimensionless.
    """

    length_m: float = HAND_LENGTH
    rotation: float = 1.0
    joints: float = 1.0

    def __post_init__(self) -> None:
        for name in ("length_m", "rotation", "joints"):
            if not getattr(self, name) > 0:
                raise ValueError(f"weight {name} must be > 0, got {getattr(self, name)}")

    def vector(self) -> Matrix:
        """Return W (19,): the objective is 1/2 |W d|^2."""
        return np.repeat([1.0 / self.length_m, self.rotation, self.joints], [3, 3, HAND_DOF])


UNIT_WEIGHTS = PreshapeWeights(length_m=1.0)
"""The weights of the paper's eq. (5), which adds m^2 and rad^2."""


def _matrix(value: ArrayLike, shape: tuple[int, ...], name: str) -> Matrix:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape or not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: allowed is a finite array of shape {shape}, got {array!r}")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, eq=False)
class PreshapeProblem:
    """One preshape to be found.

    Args:
        side: the hand.
        X_world_pb: pose of the preshaping box, in any frame called world here (4, 4).
        half: its half edges (3,), m.
        nominal_joints: q of x_n (13,), rad: the current joint angles, or a posture to stay close to.
        fingers: which fingers touch, thumb first; chosen by the box's size when left out.
        weights: the cost of leaving x_n.
        standoff_m: least and greatest distance of the palm origin from the object's palm face, along z.
        tilt_max_rad: greatest component of the palm's rotation vector away from the box's axes.

    x_n has the palm at the pose of the PB, as in the paper; the standoff keeps the answer out of the object.
    """

    side: Side
    X_world_pb: Matrix
    half: Matrix
    nominal_joints: Matrix
    fingers: tuple[str, ...] = ()
    weights: PreshapeWeights = field(default_factory=PreshapeWeights)
    standoff_m: tuple[float, float] = STANDOFF
    tilt_max_rad: float = 0.6

    def __post_init__(self) -> None:
        object.__setattr__(self, "X_world_pb", _matrix(self.X_world_pb, (4, 4), "X_world_pb"))
        object.__setattr__(self, "half", _matrix(self.half, (3,), "half"))
        object.__setattr__(self, "nominal_joints", _matrix(self.nominal_joints, (HAND_DOF,), "nominal_joints"))
        object.__setattr__(self, "fingers", tuple(self.fingers) or fingers_for(self.half))
        low, high = self.standoff_m
        if not low < high:
            raise ValueError(f"standoff_m must be an increasing pair, got {self.standoff_m}")
        if not 0.0 < self.tilt_max_rad < np.pi:
            raise ValueError(f"tilt_max_rad must be in (0, pi), got {self.tilt_max_rad}")

    @property
    def targets(self) -> Matrix:
        """Desired fingertip positions p_fid in the PB's frame (n, 3), m, in the order of `fingers`."""
        return tip_targets(self.half, self.fingers, self.side)

    @property
    def kinematics(self) -> HandKinematics:
        """The hand's kinematics."""
        return hand_kinematics(self.side)

    def nominal(self) -> Nominal:
        """Return x_n and the targets in the PB's frame."""
        index = np.array([sah_hand.FINGERS.index(finger) for finger in self.fingers])
        return Nominal(np.eye(3), np.zeros(3), np.array(self.nominal_joints), index, self.targets)

    def bounds(self) -> tuple[Matrix, Matrix]:
        """Return lower and upper bounds of d (19,): the A2, b2 of eq. (5)."""
        low, high = self.standoff_m
        k, q, tilt = self.kinematics, self.nominal_joints, np.full(3, self.tilt_max_rad)
        lower = np.concatenate([[-1.0, -1.0, -self.half[2] - high], -tilt, k.lower - q])
        upper = np.concatenate([[1.0, 1.0, -self.half[2] - low], tilt, k.upper - q])
        return lower, upper


@dataclass(frozen=True, slots=True, eq=False)
class PreshapeResult:
    """A preshape: palm pose, joints (13,) rad, worst fingertip error, scaled KKT residual, cost, effort.

    `iterations` counts the steps of all `starts` tried; `cost` is 1/2 |W d|^2, the distance from x_n.
    """

    status: PreshapeStatus
    X_world_palm: Matrix
    X_pb_palm: Matrix
    joints: Matrix
    residual_m: float
    kkt_residual: float
    cost: float
    iterations: int
    starts: int

    @property
    def reached(self) -> bool:
        """Whether the fingertips are where they should be."""
        return self.status is not PreshapeStatus.UNREACHABLE


def linearised(problem: PreshapeProblem) -> tuple[Matrix, Matrix]:
    """Return A1 (3 n, 19) and b1 (3 n,) of eq. (5): eq. (4) linearised around x_n."""
    n = 3 * len(problem.fingers)
    c, A = np.empty(n), np.empty((n, STATE_DOF))
    frames, origins, tips, J = np.empty((18, 3, 3)), np.empty((18, 3)), np.empty((4, 3)), np.empty((4, 3, HAND_DOF))
    d = np.zeros(STATE_DOF)
    tip_constraint(problem.kinematics.tables, problem.nominal(), d, frames, origins, tips, J, c, A)
    return A, -c


def paper_step(problem: PreshapeProblem) -> Matrix | None:
    """Return the d (19,) of eq. (5) as printed: min |W d|^2, A1 d = b1, A2 d <= b2; None when that is infeasible."""
    A, b = linearised(problem)
    lower, upper = problem.bounds()
    sense = np.repeat(np.array([0, 5], np.int32), [STATE_DOF, len(b)])
    H = np.diag(problem.weights.vector() ** 2)
    bounds = np.append(upper, b), np.append(lower, b)
    answer = cast(
        tuple[Matrix, float, int, object],
        daqp.solve(H, np.zeros(STATE_DOF), A, *bounds, sense),  # pyright: ignore[reportUnknownMemberType]
    )
    return answer[0] if answer[2] == 1 else None


def nominal_step(problem: PreshapeProblem, multiplier_steps: int = 20) -> Matrix:
    """Return the first step d (19,) of this solver from x_n, unbounded in length.

    With one multiplier step it has a slack of RHO; more of them take the slack away, and it is eq. (5).
    """
    A, b = linearised(problem)
    W, (lower, upper) = problem.weights.vector(), problem.bounds()
    scaled, c, s = A / HAND_LENGTH / W, -b / HAND_LENGTH, np.zeros(STATE_DOF)
    y, zero, none = np.zeros(len(b)), np.zeros(STATE_DOF), np.zeros((STATE_DOF, STATE_DOF))
    for _ in range(multiplier_steps):
        if not quadratic_step(zero, c, scaled, y, none, W * lower, W * upper, np.inf, s):
            raise ArithmeticError("a convex program was found not to be convex: non-finite input?")
        y = y + (scaled @ s + c) / RHO
    return s / W


def _limits(problem: PreshapeProblem, iterations: int) -> Limits:
    lower, upper = problem.bounds()
    return Limits(problem.weights.vector(), lower, upper, HAND_LENGTH, 0.8, iterations, 1e-7)


def start_at(problem: PreshapeProblem, joints: Matrix, yaw: float = 0.0) -> Matrix:
    """Return a start d (19,): these joints, the palm put where thumb and finger centre straddle the box.

    The joints (rad) are clipped to their limits; `yaw` (rad) turns the palm about the box's z axis.
    """
    k = problem.kinematics
    joints = np.clip(joints, k.lower, k.upper)
    tips = k.tips(joints)[0]
    center = (tips[0] + tips[1 : len(problem.fingers)].mean(axis=0)) / 2.0
    phi = np.array([0.0, 0.0, yaw])
    return np.concatenate([-exp_so3(phi) @ center, phi, joints - problem.nominal_joints])


def descend_from(problem: PreshapeProblem, start: Matrix, iterations: int = 60) -> tuple[Matrix, Outcome]:
    """Return the last iterate d (19,) and the outcome of the steps from one start."""
    d, y = start.copy(), np.zeros(3 * len(problem.fingers))
    outcome = descend(problem.kinematics.tables, problem.nominal(), _limits(problem, iterations), d, y)
    return d, outcome


def _status(outcome: Outcome) -> PreshapeStatus:
    if outcome.residual > SOLVED_RESIDUAL:
        return PreshapeStatus.UNREACHABLE
    return PreshapeStatus.SOLVED if outcome.kkt <= SOLVED_KKT else PreshapeStatus.NOT_OPTIMAL


def _order(outcome: Outcome) -> tuple[bool, float]:
    """Rank outcomes: reached ones by KKT residual, then the others by how far they miss."""
    reached = outcome.residual <= SOLVED_RESIDUAL
    return (not reached, outcome.kkt if reached else outcome.residual)


def _polished(problem: PreshapeProblem, d: Matrix, outcome: Outcome) -> tuple[Matrix, Outcome]:
    """Return d and outcome, or better ones by Newton steps without slack, with it, or by many more usual steps."""
    tables, nominal, limits = problem.kinematics.tables, problem.nominal(), _limits(problem, 0)
    attempts = (
        lambda: polish(tables, nominal, limits, d, 0.0),
        lambda: polish(tables, nominal, limits, d, RHO),
        lambda: descend_from(problem, d, LONG),
    )
    best_d, best = d, outcome
    for attempt in attempts:
        candidate, reached = attempt()
        if reached.kkt < best.kkt and reached.residual <= max(best.residual, SOLVED_RESIDUAL):
            best_d, best = candidate, reached
        if best.kkt <= SOLVED_KKT:
            break
    return best_d, best


def _starts(problem: PreshapeProblem) -> Iterator[Matrix]:
    """Yield the starts of a solve: the joints of x_n, fixed postures, and the widest ones with the palm yawed."""
    yield start_at(problem, problem.nominal_joints)
    for joints in START_POSTURES:
        yield start_at(problem, joints)
    for joints, yaw in product(WIDE_POSTURES, WIDE_YAWS):
        yield start_at(problem, joints, yaw)


def solve(problem: PreshapeProblem) -> PreshapeResult:
    """Solve eq. (5) on SE(3) with eq. (4) linearised anew at each step; pure and deterministic.

    The first start has the joints of x_n; when it does not end at a solution, fixed hand postures follow. The
    last of them, for boxes as wide as the hand, are left out when everything before has missed by `CLOSE`.
    """
    k = problem.kinematics
    best_d, best, iterations, starts = np.zeros(STATE_DOF), Outcome(0, np.inf, np.inf, np.inf), 0, 0
    for start in _starts(problem):
        if starts > len(START_POSTURES) and best.residual > CLOSE:
            break
        d, outcome = descend_from(problem, start)
        iterations, starts = iterations + outcome.iterations, starts + 1
        if _order(outcome) < _order(best):
            best_d, best = d, outcome
        if _status(best) is PreshapeStatus.SOLVED:
            break
    if best.residual < NEAR and best.kkt > SOLVED_KKT:
        best_d, best = _polished(problem, best_d, best)
        iterations += best.iterations
    X_pb_palm = transform(best_d[:3], exp_so3(best_d[3:6]))
    return PreshapeResult(
        status=_status(best),
        X_world_palm=problem.X_world_pb @ X_pb_palm,
        X_pb_palm=X_pb_palm,
        joints=np.clip(problem.nominal_joints + best_d[6:], k.lower, k.upper),
        residual_m=best.residual,
        kkt_residual=best.kkt,
        cost=best.cost,
        iterations=iterations,
        starts=starts,
    )
