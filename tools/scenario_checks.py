"""What types cannot say of a scenario: fields that must fit each other, whatever the seed draws."""

from __future__ import annotations

import re
from collections.abc import Iterator
from math import isfinite

import msgspec

from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.sah_hand import FINGERS
from preshape.hal.world import FACES, Face
from preshape.sim_backend.scenario import Range, Scenario, edges_of

_NAME = re.compile(r"[A-Za-z0-9_.-]+")


def first_objection(scenario: Scenario) -> str:
    """Return the first contradiction as `field: got ..., allowed is ...`; empty if there is none."""
    for check in _CHECKS:
        for objection in check(scenario):
            return objection
    return ""


def _not_finite(scenario: Scenario) -> Iterator[str]:
    for path, value in _numbers("", msgspec.to_builtins(scenario)):
        if not isfinite(value):
            yield f"{path}: got {value}, allowed is a finite number"


def _numbers(path: str, value: object) -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _numbers(f"{path}.{key}".removeprefix("."), item)
    elif isinstance(value, (list, tuple)):
        for index, item in enumerate(value):
            yield from _numbers(f"{path}[{index}]", item)
    elif isinstance(value, float):
        yield path, value


def _name(scenario: Scenario) -> Iterator[str]:
    if not _NAME.fullmatch(scenario.name):
        yield f"name: got {scenario.name!r}, allowed are letters, digits, '_', '.' and '-'"


def _shape(scenario: Scenario) -> Iterator[str]:
    x, y, _ = scenario.box.size_m
    if scenario.shape == "cylinder" and x != y:
        yield f"box.size_m[1]: got {y:g}, allowed is {x:g}: a cylinder stands along z and is round"
    if scenario.shape != "box" and any(scenario.box.center_of_mass_m):
        yield f"box.center_of_mass_m: got {list(scenario.box.center_of_mass_m)}, allowed is [0, 0, 0] for a solid shape"


def _faces(scenario: Scenario) -> Iterator[str]:
    size, opening = scenario.box.size_m, scenario.opening
    long_axis = "xyz"[max(range(3), key=lambda axis: size[axis])]
    beside = [face for face in FACES if face[1] != long_axis]
    named: dict[str, Face] = {"opening.face": opening.face}
    named |= {f"opening.candidate_faces[{i}]": face for i, face in enumerate(opening.candidate_faces)}
    named |= {f"draw.faces[{i}]": face for i, face in enumerate(scenario.draw.faces or ())}
    for path, face in named.items():
        if face not in beside:
            yield f"{path}: got {face}, which has no longest edge of the box, allowed are {', '.join(beside)}"
    drawn = [] if scenario.draw.faces is None else [("draw.faces", face) for face in scenario.draw.faces]
    for path, face in drawn or [("opening.face", opening.face)]:
        if face not in opening.candidate_faces:
            among = ", ".join(opening.candidate_faces) or "none"
            yield f"{path}: got {face}, allowed are opening.candidate_faces: {among}"
    if scenario.draw.faces == ():
        yield "draw.faces: got an empty list, allowed is at least one face"


def _edge(scenario: Scenario) -> Iterator[str]:
    face, edge = scenario.opening.face, scenario.opening.edge
    edges = edges_of(scenario.box.size_m, face)
    if edge not in edges:
        yield f"opening.edge: got {edge}, allowed are {', '.join(edges)}: the faces beyond the long edges of {face}"


def _tab(scenario: Scenario) -> Iterator[str]:
    size, opening, draw = scenario.box.size_m, scenario.opening, scenario.draw
    room = (max(size) - opening.tab_length_m) / 2
    if room < 0:
        yield f"opening.tab_length_m: got {opening.tab_length_m:g}, allowed is <= {max(size):g}: the longest edge"
    if abs(opening.offset_m) > room:
        yield f"opening.offset_m: got {opening.offset_m:g}, allowed is -{room:g} .. {room:g}: the tab must fit the edge"
    if abs(opening.offset_m) + draw.offset_m > room:
        left = room - abs(opening.offset_m)
        yield f"draw.offset_m: got {draw.offset_m:g}, allowed is <= {left:g}: the tab must fit the edge"
    for face in scenario.draw.faces or (opening.face,):
        depth = size["xyz".index(edges_of(size, face)[0][1])]
        if opening.tab_depth_m >= depth:
            yield f"opening.tab_depth_m: got {opening.tab_depth_m:g}, allowed is < {depth:g}: the depth of face {face}"


def _ranges(scenario: Scenario) -> Iterator[str]:
    draw, table = scenario.draw, scenario.table
    ranges: list[tuple[str, Range | None, float, float]] = [
        ("draw.friction", draw.friction, 0.0, 2.0),
        ("draw.mass_kg", draw.mass_kg, 0.0, 3.0),
        ("table.x_m", table.x_m, -5.0, 5.0),
        ("table.y_m", table.y_m, -5.0, 5.0),
    ]
    for path, bounds, lowest, highest in ranges:
        if bounds is None:
            continue
        low, high = bounds
        if not lowest < low <= high <= highest:
            allowed = f"[low, high] with {lowest:g} < low <= high <= {highest:g}"
            yield f"{path}: got [{low:g}, {high:g}], allowed is {allowed}"


def _mass(scenario: Scenario) -> Iterator[str]:
    box = scenario.box
    for index, (center, size) in enumerate(zip(box.center_of_mass_m, box.size_m, strict=True)):
        if abs(center) > size / 2:
            allowed = f"-{size / 2:g} .. {size / 2:g}: inside the box"
            yield f"box.center_of_mass_m[{index}]: got {center:g}, allowed is {allowed}"


def _place(scenario: Scenario) -> Iterator[str]:
    spread = scenario.draw.position_m
    for index, (place, edges) in enumerate(
        zip(scenario.box.position_m, (scenario.table.x_m, scenario.table.y_m), strict=True)
    ):
        low, high = edges[0] + spread, edges[1] - spread
        if not low <= place <= high:
            allowed = f"{low:g} .. {high:g}: on the table, whatever is drawn"
            yield f"box.position_m[{index}]: got {place:g}, allowed is {allowed}"


def _camera(scenario: Scenario) -> Iterator[str]:
    eye, target = scenario.camera.position_m, scenario.camera.look_at_m
    if eye[:2] == target[:2]:
        yield f"camera.look_at_m: got {list(target)}, allowed is a point not straight above or below the camera"


def _obstacles(scenario: Scenario) -> Iterator[str]:
    names = [obstacle.name for obstacle in scenario.obstacles]
    for index, name in enumerate(names):
        if not _NAME.fullmatch(name):
            yield f"obstacles[{index}].name: got {name!r}, allowed are letters, digits, '_', '.' and '-'"
        if name in names[:index]:
            yield f"obstacles[{index}].name: got {name!r} again, allowed is a name of its own"


def _frozen(scenario: Scenario) -> Iterator[str]:
    named = {f"disturbances.frozen[{i}].part": frozen.part for i, frozen in enumerate(scenario.disturbances.frozen)}
    named |= {f"draw.frozen_parts[{i}]": part for i, part in enumerate(scenario.draw.frozen_parts)}
    fingers = [f"{side}_{finger}" for side in SIDES for finger in FINGERS]
    for path, part in named.items():
        if part not in fingers and part not in LAYOUT.names:
            known = f"a finger ({', '.join(fingers)}) or a joint ({LAYOUT.names[0]}, ...)"
            yield f"{path}: got {part!r}, allowed are {known}"


def _times(scenario: Scenario) -> Iterator[str]:
    ranges: dict[str, Range | None] = {
        "draw.appears_s": scenario.draw.appears_s,
        "draw.frozen_from_s": scenario.draw.frozen_from_s,
        "disturbances.kick_delay_s": scenario.disturbances.kick_delay_s,
    }
    for path, bounds in ranges.items():
        if bounds is not None and not 0.0 <= bounds[0] <= bounds[1]:
            yield f"{path}: got [{bounds[0]:g}, {bounds[1]:g}], allowed is [low, high] with 0 <= low <= high"


_CHECKS = (
    _not_finite,
    _name,
    _shape,
    _faces,
    _edge,
    _tab,
    _ranges,
    _mass,
    _place,
    _camera,
    _obstacles,
    _frozen,
    _times,
)
