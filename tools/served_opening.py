"""The opening that a client reports to the referee of a served world, as JSON holds it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from preshape.hal.transform import Matrix
from preshape.hal.world import Face, Opening


class _Found(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    face: Face
    edge: Face
    offset: float
    X_world_box: list[list[float]]

    def __post_init__(self) -> None:
        if [len(row) for row in self.X_world_box] != [4, 4, 4, 4]:
            raise ValueError("X_world_box: allowed are 4 rows of 4 numbers")


def opening_to(opening: Opening, X_world_box: Matrix) -> dict[str, Any]:
    """Return an opening, and where the box is taken to be, as JSON can hold it."""
    return {
        "face": opening.face,
        "edge": opening.edge,
        "offset": float(opening.offset),
        "X_world_box": X_world_box.tolist(),
    }


def opening_from(arguments: Mapping[str, Any]) -> tuple[Opening, Matrix]:
    """Return what `opening_to` was given; `msgspec.ValidationError` names what is not in it."""
    found = msgspec.convert(dict(arguments), _Found)
    return Opening(found.face, found.edge, found.offset), np.array(found.X_world_box)
