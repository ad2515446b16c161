"""The stated potentials of the vector field, with finite range, and their one parameter set (paper, section IV).

Repulsion from a distance d (m, signed) with range r and strength k (N at contact), x = d / r:

    U(d) = k r / 3 (1 - x)^3           0 <= x <= 1      force k (1 - x)^2
    U(d) = k r (1/3 - x + x^2)         x < 0            force k (1 - 2 x)
    U(d) = 0                           x > 1

Attraction of an error of length e, quadratic near the goal and conical beyond e0, so that the force never
exceeds f (it must stay below k, or the pull would win at contact):

    V(e) = f e^2 / (2 e0)   e <= e0        V(e) = f (e - e0 / 2)   e > e0
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix, length, log_so3


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldParameters:
    """Everything the field is tuned by; forces are virtual and become velocities by the three mobilities."""

    range_m: float = 0.040
    """Distance beyond which nothing repels, m."""
    strength_n: float = 2.5
    """Repulsion at contact, N."""
    tie_m: float = 0.002
    """The paper's epsilon: distances this close to the minimum are ties (`hard`); the smooth weights' scale, m."""
    pull_n: float = 1.0
    """Largest attraction of the hand base's position, N."""
    near_m: float = 0.050
    """Distance from the goal below which that attraction fades, m."""
    pull_nm: float = 0.10
    """Largest attraction of the hand base's orientation, N m."""
    near_rad: float = 0.30
    """Angle below which that attraction fades, rad."""
    joint_pull_nm: float = 0.08
    """Largest attraction of a hand's joint vector, N m."""
    joint_near_rad: float = 0.20
    """Length of the joint error below which that attraction fades, rad."""
    base_mobility: float = 0.25
    """Hand base velocity per force, m/s/N."""
    turn_mobility: float = 12.0
    """Hand base angular velocity per torque, rad/s/(N m)."""
    joint_mobility: float = 15.0
    """Joint velocity per torque, rad/s/(N m)."""

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: got {value}, allowed is a positive number")
        if self.strength_n <= self.pull_n:
            raise ValueError(f"strength_n: got {self.strength_n}, allowed is more than pull_n = {self.pull_n}")


@compiled
def repulsion(d: float, reach: float, strength: float) -> tuple[float, float]:
    """Return the energy U(d) (N m) and the force -U'(d) >= 0 (N) of the stated repulsion."""
    if d >= reach or reach <= 0.0:
        return 0.0, 0.0
    x = d / reach
    if x < 0.0:
        return strength * reach * (1.0 / 3.0 - x + x * x), strength * (1.0 - 2.0 * x)
    return strength * reach * (1.0 - x) ** 3 / 3.0, strength * (1.0 - x) ** 2


def attraction_energy(error: ArrayLike, limit: float, near: float) -> float:
    """Return V of an error vector."""
    e = float(np.linalg.norm(np.asarray(error, float)))
    return limit * e * e / (2.0 * near) if e <= near else limit * (e - near / 2.0)


def attraction(error: ArrayLike, limit: float, near: float) -> Matrix:
    """Return the force -dV/d(state) for error = goal - state: towards the goal, its length at most `limit`."""
    vector = np.asarray(error, dtype=np.float64)
    return vector * (limit / max(length(vector), near))


def pose_error(X_world_goal: Matrix, X_world_palm: Matrix) -> tuple[Matrix, Matrix]:
    """Return the position error (m) and the rotation vector (rad) from a hand base to its goal, in the world frame."""
    R_palm = X_world_palm[:3, :3]
    turn = R_palm @ log_so3(R_palm.T @ X_world_goal[:3, :3])
    return X_world_goal[:3, 3] - X_world_palm[:3, 3], turn
