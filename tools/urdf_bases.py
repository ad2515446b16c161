"""Where a robot's arms stand, read from its URDF."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from preshape.hal.layout import SIDES, Side
from preshape.hal.transform import Matrix, rpy_matrix, transform


def arm_bases(urdf: str) -> dict[Side, Matrix]:
    """Return X_world_base of both arms; `ValueError` for a URDF that is not this robot's."""
    joints = {joint.get("name"): joint for joint in ElementTree.fromstring(urdf).iter("joint")}
    bases: dict[Side, Matrix] = {}
    for side in SIDES:
        joint = joints.get(f"{side}_arm_mount")
        origin = None if joint is None else joint.find("origin")
        if origin is None:
            raise ValueError(f"URDF: it has no joint {side}_arm_mount with an origin")
        xyz, rpy = (np.array(origin.get(name, "0 0 0").split(), float) for name in ("xyz", "rpy"))
        bases[side] = transform(xyz, rpy_matrix((float(rpy[0]), float(rpy[1]), float(rpy[2]))))
    return bases
