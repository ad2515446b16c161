"""The robot's URDF as a viewer draws it: visual shapes only, capsules rounded, each link in its colour."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from xml.etree import ElementTree

import numpy as np

from preshape.hal.description import capsule_links, robot_urdf
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, rpy_matrix
from preshape.tools.scene_view import link_color

ROBOT = "robot"
"""Name of the robot in the drawn URDF."""


def visual_kinds(urdf: str) -> dict[str, list[str]]:
    """Return the kinds of each link's visual shapes in their order: box, cylinder or sphere."""
    links = ElementTree.fromstring(urdf).iter("link")
    return {link.get("name", ""): [shape[0].tag for shape in link.iterfind("visual/geometry")] for link in links}


def display_urdf(X_world_base: Mapping[Side, Matrix]) -> str:
    """Return the URDF of both arms and hands for drawing."""
    robot = ElementTree.fromstring(robot_urdf(X_world_base))
    robot.set("name", ROBOT)
    rounded = capsule_links()
    for link in robot.iter("link"):
        name = link.get("name", "")
        for tag in ("inertial", "collision"):
            for element in link.findall(tag):
                link.remove(element)
        if name in rounded:
            _round_off(link)
        for visual in link.findall("visual"):
            _paint(visual, name)
    return ElementTree.tostring(robot, encoding="unicode")


def _round_off(link: ElementTree.Element) -> None:
    """Replace the cylinder, as long as the whole capsule, by its straight part and a ball at each end."""
    visual = link.find("visual")
    cylinder = None if visual is None else visual.find("geometry/cylinder")
    if visual is None or cylinder is None:
        return
    radius = float(cylinder.get("radius", "0"))
    straight = float(cylinder.get("length", "0")) - 2 * radius
    cylinder.set("length", repr(straight))
    origin = visual.find("origin")
    rpy = _numbers(origin, "rpy")
    p, axis = _numbers(origin, "xyz"), rpy_matrix((rpy[0], rpy[1], rpy[2]))[:, 2]
    for sign in (-0.5, 0.5):
        ball = deepcopy(visual)
        end = ball.find("origin")
        geometry = ball.find("geometry")
        if end is None or geometry is None:
            continue
        end.set("xyz", " ".join(repr(float(value)) for value in p + sign * straight * axis))
        geometry.clear()
        ElementTree.SubElement(geometry, "sphere", radius=repr(radius))
        link.append(ball)


def _numbers(origin: ElementTree.Element | None, name: str) -> Matrix:
    text = "0 0 0" if origin is None else origin.get(name, "0 0 0")
    return np.array(text.split(), float)


def _paint(visual: ElementTree.Element, link: str) -> None:
    r, g, b = link_color(link)
    # A material is known by its name: one colour, one name.
    material = ElementTree.SubElement(visual, "material", name=f"{r:g}_{g:g}_{b:g}")
    ElementTree.SubElement(material, "color", rgba=f"{r:g} {g:g} {b:g} 1")
