"""What the controller means to do in the rerun viewer: reciprocal points and forces, preshaping boxes, fingertips."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from preshape.hal.layout import SIDES
from preshape.hal.tick_record import GROUPS, TickRecord
from preshape.hal.transform import Matrix, quaternion_xyzw
from preshape.tools.rerun_stream import RerunStream
from preshape.tools.series import COLORS

METRES_PER_NEWTON = 0.03
"""Length of a force's arrow, m/N."""
POINT_M, TIP_M, ARROW_M = 0.006, 0.005, 0.003
"""Radii of reciprocal points, fingertip targets and arrows, m."""
BOX_COLOR = np.array([0x9A5FCBFF], np.uint32)
TIP_COLORS = np.array([0xDB7360FF, 0x5CA87AFF, 0x5CA87AFF, 0x5CA87AFF], np.uint32)


class RerunField:
    """Points, arrows and boxes of one stream."""

    def __init__(self, stream: RerunStream) -> None:
        """Choose colours and sizes."""
        self._stream = stream
        for side in SIDES:
            for number, group in enumerate(GROUPS):
                color = np.array([COLORS[number]], np.uint32)
                points, arrows = f"world/field/{side}_{group}/point", f"world/field/{side}_{group}/force"
                stream.keep(points, rr.Points3D.from_fields(colors=color, radii=POINT_M))
                stream.keep(arrows, rr.Arrows3D.from_fields(colors=color, radii=ARROW_M))
            box = rr.Boxes3D.from_fields(colors=BOX_COLOR, labels="preshaping box", show_labels=False, radii=0.002)
            stream.keep(f"world/aim/{side}_box", box)
            stream.keep(f"world/aim/{side}_tips", rr.Points3D.from_fields(colors=TIP_COLORS, radii=TIP_M))

    def send(self, records: TickRecord) -> None:
        """Draw what the controller meant to do in records (n,)."""
        for hand, side in enumerate(SIDES):
            for number, group in enumerate(GROUPS):
                point, force = records["group_point"][:, hand, number], records["group_force"][:, hand, number]
                self._send_group(f"world/field/{side}_{group}", records["now_ns"], point, force)
            self._send_box(f"world/aim/{side}_box", records, hand)
            self._send_tips(f"world/aim/{side}_tips", records, hand)

    def _send_group(self, path: str, now_ns: NDArray[np.int64], point: Matrix, force: Matrix) -> None:
        known = np.isfinite(point[:, 0])
        rows = self._stream.due(path, known)
        if not len(rows):
            return
        counts, some = known[rows].astype(int), rows[known[rows]]
        self._stream.send(f"{path}/point", now_ns[rows], rr.Points3D.columns(positions=point[some]).partition(counts))
        vectors = METRES_PER_NEWTON * force[some]
        arrows = rr.Arrows3D.columns(origins=point[some], vectors=vectors)
        self._stream.send(f"{path}/force", now_ns[rows], arrows.partition(counts))

    def _send_box(self, path: str, records: TickRecord, hand: int) -> None:
        X, half = records["X_world_preshape"][:, hand], records["preshape_half"][:, hand]
        known = np.isfinite(half[:, 0])
        rows = self._stream.due(path, known)
        if not len(rows):
            return
        some = rows[known[rows]]
        turns = np.array([quaternion_xyzw(R) for R in X[some, :3, :3]]).reshape(-1, 4)
        columns = rr.Boxes3D.columns(half_sizes=half[some], centers=X[some, :3, 3], quaternions=turns)
        self._stream.send(path, records["now_ns"][rows], columns.partition(known[rows].astype(int)))

    def _send_tips(self, path: str, records: TickRecord, hand: int) -> None:
        tips = records["tip_target"][:, hand]
        known = np.isfinite(tips[:, 0, 0])
        rows = self._stream.due(path, known)
        if not len(rows):
            return
        some = rows[known[rows]]
        columns = rr.Points3D.columns(positions=tips[some].reshape(-1, 3))
        self._stream.send(path, records["now_ns"][rows], columns.partition(len(tips[0]) * known[rows].astype(int)))
