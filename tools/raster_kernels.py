"""Ray against convex primitive, pixel by pixel into a depth buffer; compiled, no drawing interface needed.

Camera frame: x right, y down, z forward. A ray is t (u, v, 1), so its parameter t is the depth, m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled

Floats = NDArray[np.float64]

BOX, CAPSULE, CYLINDER, ELLIPSOID, CONVEX = range(5)
FACETS = 256
"""Facet numbers kept free for each shape: a box has 6, a convex body as many as it has planes."""
NEAR = 0.01
"""Nothing nearer to the camera than this is drawn, m."""
TIE = 2e-4
"""Of surfaces closer to each other than this the first drawn is seen, m: capsules share their end spheres."""
MISS = -1.0


@compiled
def hit_box(o: Floats, d: Floats, size: Floats, normal: Floats) -> tuple[float, int]:
    """Return depth and facet where a ray enters the box of half edges `size`; fills the unit normal."""
    enter, leave, axis = -1e30, 1e30, 0
    for k in range(3):
        if abs(d[k]) < 1e-15:
            if abs(o[k]) > size[k]:
                return MISS, 0
            continue
        reach = size[k] / abs(d[k])
        middle = -o[k] / d[k]
        if middle - reach > enter:
            enter, axis = middle - reach, k
        leave = min(leave, middle + reach)
    if enter > leave:
        return MISS, 0
    normal[:] = 0.0
    normal[axis] = -1.0 if d[axis] > 0 else 1.0
    return enter, 2 * axis + (1 if d[axis] > 0 else 0)


@compiled
def hit_ellipsoid(o: Floats, d: Floats, size: Floats, normal: Floats) -> tuple[float, int]:
    """Return depth and facet where a ray enters the ellipsoid of half axes `size`."""
    a, b, c = 0.0, 0.0, -1.0
    for k in range(3):
        a += (d[k] / size[k]) ** 2
        b += o[k] * d[k] / size[k] ** 2
        c += (o[k] / size[k]) ** 2
    root = b * b - a * c
    if root < 0:
        return MISS, 0
    t = (-b - np.sqrt(root)) / a
    for k in range(3):
        normal[k] = (o[k] + t * d[k]) / size[k] ** 2
    normal /= np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    return t, 0


@compiled
def hit_cylinder(o: Floats, d: Floats, size: Floats, normal: Floats) -> tuple[float, int]:
    """Return depth and facet (0 side, 1 and 2 ends) where a ray enters a cylinder along z: radius, half length."""
    radius, half = size[0], size[1]
    a = d[0] ** 2 + d[1] ** 2
    b = o[0] * d[0] + o[1] * d[1]
    c = o[0] ** 2 + o[1] ** 2 - radius**2
    enter, leave, facet = -1e30, 1e30, 0
    if a < 1e-15:
        if c > 0:
            return MISS, 0
    else:
        root = b * b - a * c
        if root < 0:
            return MISS, 0
        enter, leave = (-b - np.sqrt(root)) / a, (-b + np.sqrt(root)) / a
    if abs(d[2]) > 1e-15:
        low = -o[2] / d[2] - half / abs(d[2])
        if low > enter:
            enter, facet = low, 1 if d[2] > 0 else 2
        leave = min(leave, -o[2] / d[2] + half / abs(d[2]))
    elif abs(o[2]) > half:
        return MISS, 0
    if enter > leave:
        return MISS, 0
    normal[:] = 0.0
    if facet == 0:
        normal[0], normal[1] = (o[0] + enter * d[0]) / radius, (o[1] + enter * d[1]) / radius
    else:
        normal[2] = -1.0 if facet == 1 else 1.0
    return enter, facet


@compiled
def hit_capsule(o: Floats, d: Floats, size: Floats, normal: Floats) -> tuple[float, int]:
    """Return depth and facet where a ray enters a capsule along z: radius, half of its straight length."""
    radius, half = size[0], size[1]
    a = d[0] ** 2 + d[1] ** 2
    b = o[0] * d[0] + o[1] * d[1]
    c = o[0] ** 2 + o[1] ** 2 - radius**2
    end = -1.0 if d[2] > 0 else 1.0
    if a < 1e-15:
        if c > 0:
            return MISS, 0
    else:
        root = b * b - a * c
        if root < 0:
            return MISS, 0
        t = (-b - np.sqrt(root)) / a
        z = o[2] + t * d[2]
        if abs(z) <= half:
            normal[0], normal[1], normal[2] = (o[0] + t * d[0]) / radius, (o[1] + t * d[1]) / radius, 0.0
            return t, 0
        end = 1.0 if z > 0 else -1.0
    lift = o[2] - end * half
    aa = a + d[2] ** 2
    bb = b + lift * d[2]
    root = bb * bb - aa * (c + lift**2)
    if root < 0:
        return MISS, 0
    t = (-bb - np.sqrt(root)) / aa
    normal[0], normal[1] = (o[0] + t * d[0]) / radius, (o[1] + t * d[1]) / radius
    normal[2] = (lift + t * d[2]) / radius
    return t, 0


@compiled
def hit_convex(o: Floats, d: Floats, planes: Floats, normal: Floats) -> tuple[float, int]:
    """Return depth and facet where a ray enters the body n . x <= b; `planes` (m, 4) holds n (unit) and b."""
    enter, leave, facet = -1e30, 1e30, 0
    for m in range(len(planes)):
        slope = planes[m, 0] * d[0] + planes[m, 1] * d[1] + planes[m, 2] * d[2]
        room = planes[m, 3] - (planes[m, 0] * o[0] + planes[m, 1] * o[1] + planes[m, 2] * o[2])
        if abs(slope) < 1e-15:
            if room < 0:
                return MISS, 0
        elif slope > 0:
            leave = min(leave, room / slope)
        elif room / slope > enter:
            enter, facet = room / slope, m
    if enter > leave:
        return MISS, 0
    normal[:] = planes[facet, :3]
    return enter, facet


@compiled
def cast(
    kinds: NDArray[np.int64],
    X_camera_shape: Floats,
    sizes: Floats,
    planes: Floats,
    first_plane: NDArray[np.int64],
    windows: NDArray[np.int64],
    light: Floats,
    focal: float,
    depth: NDArray[np.float32],
    facet: NDArray[np.int32],
    shade: NDArray[np.float32],
) -> None:
    """Draw every shape into the buffers (h, w), each inside its pixel window (first/last column, first/last row).

    `planes` holds those of all convex bodies, shape s the rows from first_plane[s] to first_plane[s + 1].
    depth: m, start at infinity; facet: FACETS * shape + facet, start at -1; shade: brightness 0 .. 1 by
    Lambert's law from a lamp in direction `light` (unit, camera frame) and a weaker one at the camera.
    """
    height, width = depth.shape
    normal = np.zeros(3)
    d = np.zeros(3)
    for s in range(len(kinds)):
        R = X_camera_shape[s, :3, :3]
        p = X_camera_shape[s, :3, 3]
        o = np.zeros(3)
        lamp = np.zeros(3)
        for k in range(3):
            o[k] = -(R[0, k] * p[0] + R[1, k] * p[1] + R[2, k] * p[2])
            lamp[k] = R[0, k] * light[0] + R[1, k] * light[1] + R[2, k] * light[2]
        for row in range(windows[s, 2], windows[s, 3]):
            v = (row + 0.5 - 0.5 * height) / focal
            for column in range(windows[s, 0], windows[s, 1]):
                u = (column + 0.5 - 0.5 * width) / focal
                for k in range(3):
                    d[k] = R[0, k] * u + R[1, k] * v + R[2, k]
                if kinds[s] == BOX:
                    t, number = hit_box(o, d, sizes[s], normal)
                elif kinds[s] == CAPSULE:
                    t, number = hit_capsule(o, d, sizes[s], normal)
                elif kinds[s] == CYLINDER:
                    t, number = hit_cylinder(o, d, sizes[s], normal)
                elif kinds[s] == ELLIPSOID:
                    t, number = hit_ellipsoid(o, d, sizes[s], normal)
                else:
                    t, number = hit_convex(o, d, planes[first_plane[s] : first_plane[s + 1]], normal)
                if t < NEAR or t >= depth[row, column] - TIE:
                    continue
                facing = -(normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]) / np.sqrt(u * u + v * v + 1.0)
                lit = max(0.0, normal[0] * lamp[0] + normal[1] * lamp[1] + normal[2] * lamp[2])
                depth[row, column] = t
                facet[row, column] = FACETS * s + number
                shade[row, column] = 0.45 + 0.28 * lit + 0.27 * facing


@compiled
def draw_edges(
    depth: NDArray[np.float32], facet: NDArray[np.int32], outlined: NDArray[np.bool_], shade: NDArray[np.float32]
) -> None:
    """Darken, on the nearer side, every pixel where two facets meet, if that side's shape is outlined."""
    height, width = depth.shape
    for row in range(height - 1):
        for column in range(width - 1):
            for step in range(2):
                other_row, other_column = row + step, column + 1 - step
                if facet[row, column] == facet[other_row, other_column]:
                    continue
                r, c = row, column
                if depth[other_row, other_column] < depth[row, column]:
                    r, c = other_row, other_column
                if facet[r, c] >= 0 and outlined[facet[r, c] // FACETS]:
                    shade[r, c] = min(shade[r, c], np.float32(0.22))


@compiled
def resolve(
    facet: NDArray[np.int32],
    shade: NDArray[np.float32],
    colors: Floats,
    background: Floats,
    samples: int,
    image: NDArray[np.uint8],
) -> None:
    """Average samples x samples pixels of colour times brightness into each pixel of the image (h, w, 3).

    `background` holds the colours of its top and of its bottom row.
    """
    height, width = image.shape[0], image.shape[1]
    total = np.zeros(3)
    for row in range(height):
        share = row / max(height - 1, 1)
        for column in range(width):
            total[:] = 0.0
            for i in range(row * samples, (row + 1) * samples):
                for j in range(column * samples, (column + 1) * samples):
                    number = facet[i, j]
                    for k in range(3):
                        if number < 0:
                            total[k] += (1.0 - share) * background[0, k] + share * background[1, k]
                        else:
                            total[k] += colors[number // FACETS, k] * shade[i, j]
            for k in range(3):
                image[row, column, k] = np.uint8(min(255.0, 255.0 * total[k] / samples**2 + 0.5))
