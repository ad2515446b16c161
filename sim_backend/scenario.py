"""A scenario: everything about one world and what is drawn anew per seed. Simulator truth, never the controller's.

Types are strict and frozen; `tools` reads them from TOML. Field names carry their unit.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
import numpy as np

from preshape.hal.transform import cross
from preshape.hal.world import FACES, Face, face_normal

Length = Annotated[float, msgspec.Meta(gt=0.0, le=2.0)]
Coordinate = Annotated[float, msgspec.Meta(ge=-5.0, le=5.0)]
Point = tuple[Coordinate, Coordinate, Coordinate]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Range = tuple[float, float]


class Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every table of a scenario: frozen, keyword-only, unknown keys refused."""


class BoxSection(Section, frozen=True):
    """The paper box: outer size along its own x, y, z, physical properties and where it lies."""

    size_m: tuple[Length, Length, Length] = (0.06, 0.09, 0.20)
    mass_kg: Annotated[float, msgspec.Meta(gt=0.0, le=3.0)] = 0.15
    friction: Annotated[float, msgspec.Meta(gt=0.0, le=2.0)] = 0.6
    center_of_mass_m: Point = (0.0, 0.0, 0.0)
    position_m: tuple[Coordinate, Coordinate] = (0.55, -0.30)
    yaw_deg: float = 0.0
    rest_face: Face = "-z"


class OpeningSection(Section, frozen=True):
    """Where the box opens: the face, the long edge with the tab, the tab's offset along that edge."""

    face: Face = "+x"
    edge: Face = "+y"
    offset_m: Annotated[float, msgspec.Meta(ge=-0.2, le=0.2)] = 0.0
    candidate_faces: tuple[Face, ...] = ("+x", "-x")
    tab_length_m: Length = 0.045
    tab_depth_m: Length = 0.040


class StrengthsSection(Section, frozen=True):
    """What the box withstands: the contracted table, and one factor on all of it for studies."""

    tab_n: NonNegative = 1.5
    point_n: NonNegative = 0.5
    points: Annotated[int, msgspec.Meta(ge=3, le=60)] = 12
    crease_nm_per_rad: NonNegative = 0.01
    crease_yield_rad: NonNegative = 0.30
    crush_n: Annotated[float, msgspec.Meta(gt=0.0)] = 25.0
    tear_time_s: NonNegative = 0.003
    scale: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)] = 1.0


class TableSection(Section, frozen=True):
    """The table: its top at z = 0."""

    x_m: Range = (0.15, 0.95)
    y_m: Range = (-0.60, 0.60)
    thickness_m: Length = 0.05


class ObstacleSection(Section, frozen=True):
    """A box in the way: there from `appears_s` on, moving with a constant velocity from then.

    `origin` is what its place counts from: the world's origin, or the table under the middle of the box. One that was
    not there from the start waits until the robot and the object are `room_m` from its place: nobody can stop before
    what is already upon him. With 0 it does not wait.
    """

    name: str
    size_m: tuple[Length, Length, Length]
    position_m: Point
    origin: Literal["world", "box"] = "world"
    yaw_deg: float = 0.0
    appears_s: NonNegative = 0.0
    room_m: NonNegative = 0.06
    velocity_m_per_s: tuple[float, float, float] = (0.0, 0.0, 0.0)


class CameraSection(Section, frozen=True):
    """The camera: where it stands, what it looks at, its lens."""

    position_m: Point = (0.05, 0.0, 0.75)
    look_at_m: Point = (0.52, -0.15, 0.22)
    focal_px: Annotated[float, msgspec.Meta(gt=10.0, le=5000.0)] = 800.0
    width_px: Annotated[int, msgspec.Meta(ge=64, le=1920)] = 1280
    height_px: Annotated[int, msgspec.Meta(ge=48, le=1200)] = 720


class ArmsSection(Section, frozen=True):
    """Where both arms stand."""

    right_base_m: Point = (0.0, -0.40, 0.10)
    left_base_m: Point = (0.0, 0.40, 0.10)


class PerceptionSection(Section, frozen=True):
    """Errors of the pose estimate: white noise, a bias of its own size drawn per seed, delay, rate.

    `startup_bias_m` is added along a drawn direction until `startup_s`.
    """

    noise_m: NonNegative = 0.002
    noise_deg: NonNegative = 2.0
    bias_m: NonNegative = 0.002
    bias_deg: NonNegative = 2.0
    delay_s: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.040
    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=500.0)] = 50.0
    startup_bias_m: NonNegative = 0.0
    startup_s: NonNegative = 0.0


class FrozenSection(Section, frozen=True):
    """Torque sensors that repeat their last value with fresh stamps from `from_s` on, s since the start.

    `part` is a joint, or a finger for all of its joints: `right_thumb`, `left_fore_pip`, `right_arm_4`.
    """

    part: str
    from_s: NonNegative = 0.0


class DisturbanceSection(Section, frozen=True):
    """What goes wrong: kicks, and torque sensors that freeze.

    A kick pushes at the held box's centre with `force_n` in a drawn direction for `duration_s`, once in each task
    listed; `kick_delay_s` after the box is held in that task, drawn from the range.
    """

    kick_force_n: NonNegative = 0.0
    kick_duration_s: NonNegative = 0.1
    kick_delay_s: Range = (0.05, 0.40)
    kick_tasks: tuple[Annotated[int, msgspec.Meta(ge=1, le=5)], ...] = ()
    frozen: tuple[FrozenSection, ...] = ()


class DrawSection(Section, frozen=True):
    """What a seed draws: uniform in +- or in ranges; an absent field keeps the value of its table.

    `obstacle_m` and `appears_s` are drawn for every obstacle; `frozen_parts` draws one more part whose torque sensors
    freeze, from a time in `frozen_from_s` on.
    """

    position_m: NonNegative = 0.0
    yaw_deg: NonNegative = 0.0
    offset_m: NonNegative = 0.0
    friction: Range | None = None
    mass_kg: Range | None = None
    faces: tuple[Face, ...] | None = None
    edges: bool = False
    obstacle_m: NonNegative = 0.0
    appears_s: Range | None = None
    frozen_parts: tuple[str, ...] = ()
    frozen_from_s: Range = (0.0, 60.0)


class Scenario(Section, frozen=True):
    """One world and its draws."""

    name: str
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    shape: Literal["box", "l_carton", "cylinder"] = "box"
    box: BoxSection = BoxSection()
    opening: OpeningSection = OpeningSection()
    strengths: StrengthsSection = StrengthsSection()
    table: TableSection = TableSection()
    obstacles: tuple[ObstacleSection, ...] = ()
    camera: CameraSection = CameraSection()
    arms: ArmsSection = ArmsSection()
    perception: PerceptionSection = PerceptionSection()
    disturbances: DisturbanceSection = DisturbanceSection()
    draw: DrawSection = DrawSection()

    def drawn(self, seed: int) -> Scenario:
        """Return the scenario with every drawn quantity fixed by `seed`; the same seed draws the same world."""
        rng = np.random.default_rng((0x5EED, seed))
        draw, box, opening = self.draw, self.box, self.opening
        dx, dy = rng.uniform(-1, 1, 2) * draw.position_m
        yaw = box.yaw_deg + rng.uniform(-1, 1) * draw.yaw_deg
        u_friction, u_mass, u_offset, u_face, u_edge = rng.uniform(size=5)
        face = opening.face if draw.faces is None else draw.faces[int(u_face * len(draw.faces))]
        edge = same_side_edge(box.size_m, opening.face, opening.edge, face)
        if draw.edges:
            edge = edges_of(box.size_m, face)[int(u_edge * 2)]
        x, y = box.position_m[0] + float(dx), box.position_m[1] + float(dy)
        return msgspec.structs.replace(
            self,
            seed=seed,
            box=msgspec.structs.replace(
                box,
                position_m=(x, y),
                yaw_deg=float(yaw),
                friction=float(_within(draw.friction, u_friction, box.friction)),
                mass_kg=float(_within(draw.mass_kg, u_mass, box.mass_kg)),
            ),
            opening=msgspec.structs.replace(
                opening, face=face, edge=edge, offset_m=opening.offset_m + float((2 * u_offset - 1) * draw.offset_m)
            ),
            obstacles=tuple(_drawn_obstacle(obstacle, draw, (x, y), rng) for obstacle in self.obstacles),
            disturbances=_drawn_disturbances(self.disturbances, draw, rng),
            draw=DrawSection(),
        )


def _drawn_obstacle(
    obstacle: ObstacleSection, draw: DrawSection, box_m: tuple[float, float], rng: np.random.Generator
) -> ObstacleSection:
    """Return an obstacle with its place in the world and its time fixed."""
    place = np.array(obstacle.position_m) + rng.uniform(-1.0, 1.0, 3) * draw.obstacle_m
    if obstacle.origin == "box":
        place[:2] += box_m
    x, y, z = place.tolist()
    appears_s = float(_within(draw.appears_s, rng.uniform(), obstacle.appears_s))
    return msgspec.structs.replace(obstacle, position_m=(x, y, z), origin="world", appears_s=appears_s)


def _drawn_disturbances(section: DisturbanceSection, draw: DrawSection, rng: np.random.Generator) -> DisturbanceSection:
    """Return the disturbances with the drawn frozen part added."""
    if not draw.frozen_parts:
        return section
    part = draw.frozen_parts[int(rng.integers(len(draw.frozen_parts)))]
    frozen = FrozenSection(part=part, from_s=float(rng.uniform(*draw.frozen_from_s)))
    return msgspec.structs.replace(section, frozen=(*section.frozen, frozen))


def edges_of(size_m: tuple[float, float, float], face: Face) -> tuple[Face, Face]:
    """Return the two faces beyond the long edges of a face (those parallel to the box's longest edge)."""
    long_axis = "xyz"[int(np.argmax(size_m))]
    edges: list[Face] = [f for f in FACES if f[1] not in (face[1], long_axis)]
    return edges[0], edges[1]


def same_side_edge(size_m: tuple[float, float, float], face: Face, edge: Face, other: Face) -> Face:
    """Return the edge of `other` that lies, seen from outside with the long axis up, where `edge` lies on `face`."""
    long_axis = np.eye(3)[int(np.argmax(size_m))]

    def side(of: Face, at: Face) -> float:
        return float(cross(long_axis, face_normal(of)) @ face_normal(at))

    return next(candidate for candidate in edges_of(size_m, other) if side(other, candidate) == side(face, edge))


def _within(bounds: Range | None, u: float, default: float) -> float:
    return default if bounds is None else bounds[0] + u * (bounds[1] - bounds[0])
