"""What the whole field costs: kinematics of all boxes, distances, ties, potentials and G^T f for both hands."""

from __future__ import annotations

import time

import numpy as np

from preshape.control.distances import NORMS
from preshape.control.field import FIELD_MODES, Field, FieldOptions
from preshape.control.groups import TIES
from preshape.control.link_boxes import NODE_COUNT, LinkBoxes
from preshape.control.obstacles import Kind, Obstacles
from preshape.hal.layout import LAYOUT
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.hal.world import FACES, OrientedBox, face_normal

_HOME = np.array([-1.372, -0.859, 1.185, -2.359, 0.814, 1.836, -0.890])
_MIRROR = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
_BOX_SIZE = np.array([0.06, 0.09, 0.20])


def _walls() -> list[OrientedBox]:
    """Return the six walls of the tea box, 2 mm thick."""
    half = _BOX_SIZE / 2
    walls: list[OrientedBox] = []
    for face in FACES:
        normal = face_normal(face)
        thick = np.abs(normal)
        size = half * (1 - thick) + 0.001 * thick
        walls.append(OrientedBox(face, transform(normal * (thick @ half - 0.001)), size))
    return walls


def bench_scene(options: FieldOptions) -> tuple[Field, Matrix]:
    """Return a field over both arms and hands, the box's walls, table and column, and the joint angles at home."""
    q = np.zeros(LAYOUT.dof)
    q[LAYOUT.arm("right")], q[LAYOUT.arm("left")] = _HOME, _HOME * _MIRROR
    q[LAYOUT.hand("right")] = q[LAYOUT.hand("left")] = 0.3
    links = LinkBoxes()
    links.update(q)
    obstacles = Obstacles(links)
    table = OrientedBox("table", transform((0.55, 0.0, -0.025)), np.array([0.4, 0.6, 0.025]))
    column = OrientedBox("column", transform((-0.075, 0.0, 0.45)), np.array([0.095, 0.07, 0.45]))
    obstacles.add("table", Kind.ENVIRONMENT, [table])
    obstacles.add("column", Kind.ENVIRONMENT, [column])
    obstacles.add("box", Kind.OBJECT, _walls())
    return Field(links, obstacles, options), q


def pair_count(field: Field) -> int:
    """Return the number of (link box, obstacle box) pairs that one evaluation covers."""
    seen = field.obstacles.seen[:, : int(field.obstacles.last.max())]
    return int(18 * seen.sum()) if seen.shape[1] >= NODE_COUNT else 0


def _place(far: bool) -> Matrix:
    """Return X_palm_box: out of range, or its end cap 20 mm before the palm between thumb and fingers."""
    if far:
        return transform((0.0, 0.0, 0.6))
    return transform((0.052, 0.0, 0.235), exp_so3([0.02, -0.03, 0.05]))


def _median_us(field: Field, q: Matrix, repeats: int) -> float:
    times: list[float] = []
    for _ in range(repeats):
        start = time.perf_counter()
        field.links.update(q)
        field.evaluate()
        times.append(time.perf_counter() - start)
    return float(np.median(times)) * 1e6


def bench_field(repeats: int = 300) -> dict[str, float]:
    """Return the pairs covered and the median microseconds of kinematics and field, far and near, for every switch."""
    report: dict[str, float] = {}
    for norm in NORMS:
        for ties in TIES:
            for mode in FIELD_MODES:
                field, q = bench_scene(FieldOptions(norm=norm, ties=ties, mode=mode))
                report["pairs"] = float(pair_count(field))
                for far in (True, False):
                    field.obstacles.move("box", field.links.palm("right") @ _place(far))
                    field.links.update(q)
                    field.evaluate()
                    name = f"{norm}_{ties}_{mode}_{'far' if far else 'near'}_us"
                    report[name] = _median_us(field, q, repeats)
    return report


if __name__ == "__main__":
    for name, value in bench_field().items():
        print(f"{name:32s} {value:12.2f}")
