"""Regions are an exact Boolean algebra of sets of patches."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from preshape.hal.world import FACES, end_caps, long_faces
from preshape.planner.region import PATCHES, WHOLE, Patch, Region, patches_of

AXES = st.integers(0, 2)
MASKS = st.integers(0, WHOLE)


@given(AXES, MASKS, MASKS, MASKS)
def test_union_intersection_and_complement_are_those_of_sets(axis: int, a: int, b: int, c: int) -> None:
    A, B, C = Region(axis, a), Region(axis, b), Region(axis, c)
    whole = Region.whole(axis)
    assert (A | B).patches == A.patches | B.patches
    assert (A & B).patches == A.patches & B.patches
    assert (A - B).patches == A.patches - B.patches
    assert (~A).patches == whole.patches - A.patches
    assert (A <= B) == (A.patches <= B.patches)
    assert len(A) == len(A.patches)
    assert ~(A | B) == ~A & ~B
    assert A & (B | C) == (A & B) | (A & C)
    assert A | (A & B) == A
    assert A | ~A == whole
    assert not A & ~A


@given(AXES, MASKS)
def test_region_is_rebuilt_from_its_patches(axis: int, mask: int) -> None:
    region = Region(axis, mask)
    assert Region.of(axis, region) == region
    assert all(patch in region for patch in region.patches)
    assert all((patch in region) != (patch in ~region) for patch in patches_of(axis))


def share_an_edge(axis: int, a: Patch, b: Patch) -> bool:
    """Return whether two patches touch along an edge: their rectangles on the cube of edge 3 share a segment."""

    def span(patch: Patch) -> list[tuple[float, float]]:
        section, face = patch
        spans = [(0.0, 3.0)] * 3
        spans[axis] = (float(section), float(section + 1))
        k = "xyz".index(face[1])
        spans[k] = (3.0, 3.0) if face[0] == "+" else (0.0, 0.0)
        return spans

    overlap = [min(p[1], q[1]) - max(p[0], q[0]) for p, q in zip(span(a), span(b), strict=True)]
    return min(overlap) == 0.0 and sum(o > 0.0 for o in overlap) == 1


@given(AXES, MASKS)
def test_parts_are_the_connected_pieces(axis: int, mask: int) -> None:
    region = Region(axis, mask)
    parts = region.parts()
    assert sum(len(part) for part in parts) == len(region)
    union = Region(axis, 0)
    for part in parts:
        union = union | part
    assert union == region
    for k, one in enumerate(parts):
        for other in parts[k + 1 :]:
            assert not any(share_an_edge(axis, a, b) for a, b in product(one, other))
        reached = {next(iter(one))}
        while True:
            more = {b for a, b in product(reached, one) if share_an_edge(axis, a, b)} - reached
            if not more:
                break
            reached |= more
        assert reached == one.patches


@pytest.mark.parametrize("axis", range(3))
def test_surface_has_four_long_faces_in_three_sections_and_two_caps(axis: int) -> None:
    patches = patches_of(axis)
    assert len(set(patches)) == PATCHES == 14
    assert {face for _, face in patches} == set(FACES)
    assert set(long_faces(axis)) | set(end_caps(axis)) == set(FACES)
    low, high = end_caps(axis)
    assert low[0] == "-"
    assert high[0] == "+"
    assert {patch for patch in patches if patch[1] in (low, high)} == {(0, low), (2, high)}


@given(AXES, st.integers(-1, 3), st.sampled_from(FACES))
def test_patch_that_does_not_exist_is_refused(axis: int, section: int, face: str) -> None:
    patch = (section, face)
    if patch in patches_of(axis):
        assert len(Region.of(axis, [patch])) == 1  # type: ignore[list-item]
    else:
        with pytest.raises(ValueError, match="patch"):
            Region.of(axis, [patch])  # type: ignore[list-item]


def test_regions_of_different_boxes_do_not_combine() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        a, b = rng.choice(3, 2, replace=False)
        with pytest.raises(ValueError, match="different longest edges"):
            Region(int(a), 1) | Region(int(b), 1)
