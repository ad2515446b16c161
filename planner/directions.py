"""Unit directions in space."""

from __future__ import annotations

import numpy as np

from preshape.hal.transform import Matrix


def square_to(normal: Matrix) -> tuple[Matrix, Matrix]:
    """Return u, v (3,) so that u, v, normal / |normal| are a right-handed orthonormal frame."""
    n = normal / float(np.sqrt(normal @ normal))
    u = np.zeros(3)
    u[int(np.argmin(np.abs(n)))] = 1.0
    u = u - n * float(u @ n)
    u /= float(np.sqrt(u @ u))
    return u, np.array([n[1] * u[2] - n[2] * u[1], n[2] * u[0] - n[0] * u[2], n[0] * u[1] - n[1] * u[0]])
