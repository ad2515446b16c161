"""The print on the box: every face a seeded grey picture with decoys, one with the opening area on it.

A texture is an array of rows and columns at `PIXELS_PER_M`: columns along the face's u axis, the first row at
its largest v (`preshape.hal.box_face`), so it looks as the face does from outside with u to the right.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from preshape.hal.box_face import FaceFrame, face_frame
from preshape.hal.world import FACES, Face, TextureLibrary
from preshape.sim_backend.scenario import Scenario

Picture = NDArray[np.float64]
PIXELS_PER_M = 2000.0
"""0.5 mm a pixel."""
PAPER, INK = 232.0, 38.0
SHOW_THROUGH = 0.08
"""Share of the face's own print that shows through the opening area."""

_GLYPHS = {
    "P": "1111010001100011111010000100001000",
    "R": "11110100011000111110101001001010001",
    "E": "11111100001000011110100001000011111",
    "S": "01111100001000001110000010000111110",
    "H": "10001100011000111111100011000110001",
    " ": "0" * 35,
}


@dataclass(frozen=True, slots=True)
class _Slot:
    """A rectangle of a texture, in pixels."""

    row: int
    col: int
    rows: int
    cols: int

    def overlaps(self, other: _Slot, gap: int) -> bool:
        apart = (
            self.row >= other.row + other.rows + gap
            or other.row >= self.row + self.rows + gap
            or self.col >= other.col + other.cols + gap
            or other.col >= self.col + self.cols + gap
        )
        return not apart

    def of(self, picture: Picture) -> Picture:
        return picture[self.row : self.row + self.rows, self.col : self.col + self.cols]


def _pixels(length_m: float) -> int:
    return round(length_m * PIXELS_PER_M)


def _outline(picture: Picture, width: int, dash: int = 0, gap: int = 0) -> None:
    """Draw a frame along the picture's border in place; with a dash, a perforation."""
    rows, cols = picture.shape
    r, c = np.mgrid[:rows, :cols]
    border = np.minimum.reduce([r, c, rows - 1 - r, cols - 1 - c])
    along = np.where(np.minimum(r, rows - 1 - r) < width, c, r)
    inked = border < width
    if dash:
        inked &= along % (dash + gap) < dash
    picture[inked] = INK


def _write(picture: Picture, text: str, row: int, col: int, scale: int = 1) -> None:
    """Write text of 5 x 7 glyphs in place, left to right from (row, col)."""
    for letter in text:
        glyph = (
            np.array([int(bit) for bit in _GLYPHS[letter].ljust(35, "0")])
            .reshape(7, 5)
            .repeat(scale, 0)
            .repeat(scale, 1)
        )
        area = picture[row : row + 7 * scale, col : col + 5 * scale]
        area[glyph[: area.shape[0], : area.shape[1]] == 1] = INK
        col += 6 * scale


def _disc(
    picture: Picture, row: float, col: float, radii: tuple[float, float], shade: float, share: float = 1.0
) -> None:
    """Blend an ellipse of one shade into the picture in place."""
    r, c = np.mgrid[: picture.shape[0], : picture.shape[1]]
    inside = ((r - row) / radii[0]) ** 2 + ((c - col) / radii[1]) ** 2 <= 1.0
    picture[inside] += share * (shade - picture[inside])


def _chevron(picture: Picture, row: int, height: int, width: int, thickness: int) -> None:
    """Draw a V that points to the last row, centred in its columns, in place."""
    r, c = np.mgrid[: picture.shape[0], : picture.shape[1]]
    tip = row + height - np.abs(c - (picture.shape[1] - 1) / 2) * (2.0 * height / width)
    picture[(r <= tip) & (r > tip - thickness) & (r >= row)] = INK


def opening_template(tab_length_m: float, tab_depth_m: float) -> NDArray[np.uint8]:
    """Return the opening area's print: columns along the long edge, the last row at that edge.

    A perforated outline, the words to press, a chevron towards the edge and a thumb's mark. On a face whose
    tab lies at -v it appears as it is, at +v turned by half a turn.
    """
    rows, cols = _pixels(tab_depth_m), _pixels(tab_length_m)
    picture = np.full((rows, cols), PAPER)
    _outline(picture, width=3, dash=7, gap=4)
    letter = max(1, (cols - 12) // 60)
    _write(picture, "PRESS HERE", 8, (cols - 59 * letter) // 2, letter)
    _chevron(picture, int(0.28 * rows), int(0.22 * rows), int(0.62 * cols), 7)
    middle = (cols - 1) / 2
    _disc(picture, 0.76 * rows, middle, (0.16 * rows, 0.20 * cols), INK)
    _disc(picture, 0.76 * rows, middle, (0.09 * rows, 0.12 * cols), PAPER)
    return picture.astype(np.uint8)


def texture_library(tab_length_m: float, tab_depth_m: float) -> TextureLibrary:
    """Return what the controller is told of the opening area's look."""
    return TextureLibrary(opening_template(tab_length_m, tab_depth_m), PIXELS_PER_M, (tab_length_m, tab_depth_m))


def face_textures(scenario: Scenario) -> dict[Face, NDArray[np.uint8]]:
    """Return the print of all six faces of a drawn scenario; the same scenario and seed give the same pixels."""
    opening = scenario.opening
    size = (_pixels(opening.tab_depth_m), _pixels(opening.tab_length_m))
    textures: dict[Face, NDArray[np.uint8]] = {}
    for index, face in enumerate(FACES):
        rng = np.random.default_rng((0x7E47, scenario.seed, index))
        frame = face_frame(scenario.box.size_m, face)
        picture = _background(rng, frame)
        taken: list[_Slot] = []
        if face == opening.face:
            sign = frame.edge_sign(opening.edge)
            taken.append(_edge_slot(picture, size, opening.offset_m, sign))
            _print_opening(picture, taken[0], opening_template(opening.tab_length_m, opening.tab_depth_m), sign)
        _print_decoys(rng, picture, size, taken)
        textures[face] = np.clip(picture, 0, 255).astype(np.uint8)
    return textures


def _edge_slot(picture: Picture, size: tuple[int, int], offset_m: float, sign: int) -> _Slot:
    """Return the rectangle at the long edge on the +-v side whose middle has u = offset."""
    rows, cols = size
    middle = picture.shape[1] / 2 + offset_m * PIXELS_PER_M
    col = int(np.clip(round(middle - cols / 2), 0, picture.shape[1] - cols))
    return _Slot(0 if sign > 0 else picture.shape[0] - rows, col, rows, cols)


def _print_opening(picture: Picture, slot: _Slot, template: NDArray[np.uint8], sign: int) -> None:
    pattern = template[::-1, ::-1] if sign > 0 else template
    area = slot.of(picture)
    area[:] = (1 - SHOW_THROUGH) * pattern + SHOW_THROUGH * area


def _background(rng: np.random.Generator, frame: FaceFrame) -> Picture:
    """Return a shaded ground with stripes, leaves, a brand block, text lines and a bar code."""
    rows, cols = _pixels(2 * frame.half[1]), _pixels(2 * frame.half[0])
    r, c = np.mgrid[:rows, :cols]
    picture = np.full((rows, cols), rng.uniform(150.0, 205.0))
    for _ in range(3):
        wave = rng.uniform(-0.05, 0.05, 2)
        picture += rng.uniform(4.0, 10.0) * np.sin(wave[0] * r + wave[1] * c + rng.uniform(0, 6.3))
    for _ in range(int(rng.integers(6, 14))):
        _disc(
            picture, rng.uniform(0, rows), rng.uniform(0, cols), tuple(rng.uniform(4, 22, 2)), rng.uniform(90, 230), 0.6
        )
    for paint in (_stripes, _brand, _text_lines, _text_lines, _bar_code):
        if rng.uniform() < 0.8:
            paint(rng, picture)
    if rng.uniform() < 0.5:
        margin = int(rng.integers(4, 9))
        _outline(picture[margin:-margin, margin:-margin], width=2)
    return picture


def _somewhere(rng: np.random.Generator, picture: Picture, rows: int, cols: int) -> Picture:
    """Return a view of a random rectangle of at most this size."""
    rows, cols = min(rows, picture.shape[0]), min(cols, picture.shape[1])
    row, col = rng.integers(0, picture.shape[0] - rows + 1), rng.integers(0, picture.shape[1] - cols + 1)
    return picture[row : row + rows, col : col + cols]


def _stripes(rng: np.random.Generator, picture: Picture) -> None:
    area = _somewhere(rng, picture, int(rng.integers(20, 80)), int(rng.integers(60, 300)))
    r, c = np.mgrid[: area.shape[0], : area.shape[1]]
    area[(r + int(rng.integers(-2, 3)) * c) % int(rng.integers(10, 20)) < 4] = rng.uniform(80, 230)


def _brand(rng: np.random.Generator, picture: Picture) -> None:
    area = _somewhere(rng, picture, int(rng.integers(30, 60)), int(rng.integers(80, 200)))
    area[:] = rng.uniform(50, 110)
    _disc(area, area.shape[0] / 2, area.shape[1] / 2, (area.shape[0] * 0.3, area.shape[1] * 0.35), 220.0)


def _text_lines(rng: np.random.Generator, picture: Picture) -> None:
    lines = int(rng.integers(2, 6))
    area = _somewhere(rng, picture, 12 * lines, int(rng.integers(50, 160)))
    for row in range(0, area.shape[0] - 7, 12):
        _pseudo_text(rng, area[row : row + 7])


def _pseudo_text(rng: np.random.Generator, area: Picture) -> None:
    """Fill a line of 7 rows with marks that look like letters."""
    for col in range(0, area.shape[1] - 6, 6):
        if rng.uniform() < 0.85:
            area[:, col : col + 5][rng.uniform(size=area[:, col : col + 5].shape) < 0.5] = INK


def _bar_code(rng: np.random.Generator, picture: Picture) -> None:
    area = _somewhere(rng, picture, 30, 60)
    area[:] = PAPER
    area[:, np.repeat(rng.uniform(size=area.shape[1] // 2 + 1) < 0.5, 2)[: area.shape[1]]] = INK


def _decoy_frame(rng: np.random.Generator, area: Picture) -> None:
    """Draw a frame of the opening area's size with a solid line and text: no perforation."""
    area[:] = PAPER
    _outline(area, width=3)
    for row in range(10, area.shape[0] - 10, 12):
        _pseudo_text(rng, area[row : row + 7, 8:-8])


def _decoy_round(rng: np.random.Generator, area: Picture) -> None:
    """Draw a round perforation with a mark in its middle."""
    rows, cols = area.shape
    r, c = np.mgrid[:rows, :cols] - np.array([rows / 2, cols / 2])[:, None, None]
    radius, turn = np.hypot(r, c), np.arctan2(r, c)
    area[radius < 0.48 * rows] = PAPER
    area[(np.abs(radius - 0.46 * rows) < 1.6) & (np.mod(turn * 12 / np.pi, 2) < 1.3)] = INK
    _disc(area, rows / 2, cols / 2, (0.14 * rows, 0.14 * rows), float(rng.uniform(30, 90)))


def _decoy_coupon(rng: np.random.Generator, area: Picture) -> None:
    """Draw a perforated rectangle of another shape, with text."""
    inner = area[area.shape[0] // 4 : -area.shape[0] // 4]
    inner[:] = PAPER
    _outline(inner, width=3, dash=7, gap=4)
    _pseudo_text(rng, inner[inner.shape[0] // 2 - 3 : inner.shape[0] // 2 + 4, 8:-8])


def _decoy_arrow(rng: np.random.Generator, area: Picture) -> None:
    """Draw a panel of the opening area's size with the words and a chevron, but neither perforation nor thumb mark."""
    upright = area if rng.uniform() < 0.5 else area[::-1, ::-1]
    upright[:] = PAPER
    _write(upright, "PRESS", int(0.75 * area.shape[0]), 10, 2)
    _chevron(upright, int(0.15 * area.shape[0]), int(0.3 * area.shape[0]), int(0.5 * area.shape[1]), 7)


_DECOYS: tuple[Callable[[np.random.Generator, Picture], None], ...] = (
    _decoy_frame,
    _decoy_round,
    _decoy_coupon,
    _decoy_arrow,
)


def _print_decoys(rng: np.random.Generator, picture: Picture, size: tuple[int, int], taken: list[_Slot]) -> None:
    """Print two to four decoys at the long edges, the middle of the face's edges first, clear of what is taken."""
    if picture.shape[0] < size[0] or picture.shape[1] < size[1]:
        return
    wanted = int(rng.integers(2, 5))
    offsets = [rng.uniform(-0.012, 0.012)] + list(
        rng.permutation([-0.065, 0.065, -0.03, 0.03]) + rng.uniform(-0.008, 0.008, 4)
    )
    kinds = list(rng.permutation(len(_DECOYS)))
    for offset in offsets:
        for sign in (int(s) for s in rng.permutation([-1, 1])):
            slot = _edge_slot(picture, size, float(offset), sign)
            if len(taken) > wanted or not kinds or any(slot.overlaps(other, gap=4) for other in taken):
                continue
            taken.append(slot)
            _DECOYS[kinds.pop()](rng, slot.of(picture))
