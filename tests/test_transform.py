"""Laws of transforms and of the small vector functions, which say what numpy's say bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.hal.transform import cross, exp_so3, inverse, length, log_so3, transform

POSES = [transform(p, exp_so3(w)) for p, w in np.random.default_rng(3).normal(size=(50, 2, 3))]


def test_an_inverse_takes_every_pose_back_and_is_the_same_alone_and_in_a_stack() -> None:
    stack = inverse(np.array(POSES))
    for X, X_inverse in zip(POSES, stack, strict=True):
        np.testing.assert_array_equal(inverse(X), X_inverse)
        np.testing.assert_allclose(X @ X_inverse, np.eye(4), atol=1e-14)


@pytest.mark.parametrize("scale", [1.0, 1e-12, 1e12])
def test_cross_product_and_length_are_numpys(scale: float) -> None:
    for a, b in scale * np.random.default_rng(4).normal(size=(200, 2, 3)):
        np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
        assert length(a) == np.linalg.norm(a)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.0, np.pi])
def test_the_logarithm_of_a_rotation_is_the_vector_it_was_made_from(angle: float) -> None:
    for axis in np.random.default_rng(5).normal(size=(50, 3)):
        w = axis * (angle / length(axis))
        found = log_so3(exp_so3(w))
        # By pi both directions of the axis give the same rotation.
        off = min(length(found - w), length(found + w)) if angle == np.pi else length(found - w)
        assert off < 1e-7
