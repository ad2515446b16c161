"""Products of small matrices inside compiled code, where numba's own would ask for SciPy's BLAS."""

from __future__ import annotations

import numpy as np

from preshape.hal.compiled import compiled
from preshape.hal.transform import Matrix


@compiled
def mat_mat(A: Matrix, B: Matrix) -> Matrix:
    """Return A B."""
    out = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            a = A[i, k]
            for j in range(B.shape[1]):
                out[i, j] += a * B[k, j]
    return out


@compiled
def mat_vec(A: Matrix, x: Matrix) -> Matrix:
    """Return A x."""
    out = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        s = 0.0
        for k in range(A.shape[1]):
            s += A[i, k] * x[k]
        out[i] = s
    return out


@compiled
def mat_t_vec(A: Matrix, x: Matrix) -> Matrix:
    """Return A' x."""
    out = np.zeros(A.shape[1])
    for k in range(A.shape[0]):
        for i in range(A.shape[1]):
            out[i] += A[k, i] * x[k]
    return out
