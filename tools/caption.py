"""Text on pictures with the font that comes with Pillow: no font of the machine is needed."""

from __future__ import annotations

from functools import cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from preshape.tools.raster import Picture

INK = (25, 28, 36)
PAPER = (250, 250, 252)


@cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the built-in font at a size in pixels."""
    return ImageFont.load_default(size)


def text_width(text: str, size: int) -> int:
    """Return how many pixels wide a line of text is."""
    return int(np.ceil(font(size).getbbox(text)[2]))


def fitted(text: str, width: int, size: int) -> str:
    """Return the text, cut with an ellipsis where it would be wider than `width` pixels."""
    if text_width(text, size) <= width:
        return text
    while text and text_width(text + "...", size) > width:
        text = text[:-1]
    return text + "..."


def write(
    picture: Picture, lines: list[str], column: int, row: int, size: int = 14, ink: tuple[int, int, int] = INK
) -> Picture:
    """Return a copy of the picture with lines of text whose upper left corner is at (column, row)."""
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    for number, line in enumerate(lines):
        draw.text((column, row + number * round(1.3 * size)), line, fill=ink, font=font(size))
    return np.array(image)


def captioned(picture: Picture, lines: list[str], size: int = 14) -> Picture:
    """Return the picture with a strip of text below it, as wide as the picture."""
    width = picture.shape[1]
    strip = np.full((round(1.3 * size) * len(lines) + 8, width, 3), PAPER, np.uint8)
    return np.vstack([picture, write(strip, [fitted(line, width - 8, size) for line in lines], 4, 3, size)])


def grid(cells: list[Picture], columns: int, gap: int = 6) -> Picture:
    """Return pictures of one size laid out row by row with a gap (pixels) between them and around."""
    if not cells or columns < 1:
        raise ValueError(f"a grid needs pictures and columns >= 1, got {len(cells)} and {columns}")
    height, width = cells[0].shape[:2]
    rows = -(-len(cells) // columns)
    sheet = np.full((rows * (height + gap) + gap, columns * (width + gap) + gap, 3), PAPER, np.uint8)
    for number, cell in enumerate(cells):
        top, left = gap + number // columns * (height + gap), gap + number % columns * (width + gap)
        sheet[top : top + height, left : left + width] = cell
    return sheet
