"""Line plots as inline SVG: no script, no font, no file beside the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from preshape.tools.series import COLORS, Series

WIDTH, HEIGHT = 900, 200
LEFT, RIGHT, TOP, BOTTOM = 56, 10, 24, 26
"""Margins around the plotted area, px."""
HEADROOM = 1.16
"""Top of the value axis over the highest value: room for what the marks are called."""


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """One plot: lines over time (s), a title, the values' unit, a level to compare with, and marks along time."""

    title: str
    unit: str
    time_s: NDArray[np.float64]
    series: Series
    level: float | None = None
    marks: Sequence[tuple[float, str]] = ()
    logarithmic: bool = False


def svg(plot: Plot) -> str:
    """Return the plot as one `<svg>` element; `ValueError` when times and values have different lengths."""
    if len(plot.time_s) != len(plot.series.values):
        raise ValueError(f"{plot.title}: {len(plot.time_s)} times for {len(plot.series.values)} values")
    axes = _Axes(plot)
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(plot.title, quote=True)}">',
        f'<text x="{LEFT}" y="15" class="title">{escape(_titled(plot))}</text>',
        *_legend(plot.series.names),
        *_grid(plot, axes),
        *(_line(plot, axes, column) for column in range(len(plot.series.names))),
        "</svg>",
    ]
    return "\n".join(parts)


def _titled(plot: Plot) -> str:
    return f"{plot.title}, {plot.unit}" if plot.unit else plot.title


class _Axes:
    """From time and value to pixels; a logarithmic value axis begins at 1."""

    def __init__(self, plot: Plot) -> None:
        values = plot.series.values[np.isfinite(plot.series.values)]
        self._logarithmic = plot.logarithmic
        highest = max([float(values.max(initial=0.0)), plot.level or 0.0]) or 1.0
        lowest = min(float(values.min(initial=0.0)), 0.0)
        self.low, self.high = (1.0, max(highest, 10.0)) if plot.logarithmic else (lowest, highest * HEADROOM)
        self.start, self.end = (float(plot.time_s[0]), float(plot.time_s[-1])) if len(plot.time_s) else (0.0, 1.0)
        self.end = max(self.end, self.start + 1e-9)

    def x(self, time_s: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return pixels from the left."""
        return LEFT + (np.asarray(time_s) - self.start) / (self.end - self.start) * (WIDTH - LEFT - RIGHT)

    def y(self, value: NDArray[np.float64] | float) -> NDArray[np.float64]:
        """Return pixels from the top."""
        if self._logarithmic:
            share = np.log(np.maximum(value, self.low) / self.low) / np.log(self.high / self.low)
        else:
            share = (np.asarray(value) - self.low) / (self.high - self.low)
        return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM)

    def value_ticks(self) -> list[float]:
        """Return round values along the value axis."""
        if self._logarithmic:
            return [10.0**k for k in range(int(np.log10(self.high)) + 1)]
        return _round_steps(self.low, self.high, 4)

    def time_ticks(self) -> list[float]:
        """Return round times."""
        return _round_steps(self.start, self.end, 10)


def _round_steps(low: float, high: float, count: int) -> list[float]:
    step = (high - low) / count
    unit = 10.0 ** np.floor(np.log10(step))
    step = unit * next(m for m in (1, 2, 5, 10) if m * unit >= step * 0.999)
    return [float(k * step) for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]


def _grid(plot: Plot, axes: _Axes) -> list[str]:
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM
    parts: list[str] = []
    for value in axes.value_ticks():
        y = float(axes.y(value))
        parts.append(f'<line x1="{LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}" class="grid"/>')
        parts.append(f'<text x="{LEFT - 5}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>')
    for time_s in axes.time_ticks():
        parts.append(
            f'<text x="{float(axes.x(time_s)):.1f}" y="{bottom + 15}" text-anchor="middle">{time_s:g} s</text>'
        )
    for time_s, label in plot.marks:
        x = float(axes.x(time_s))
        parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{bottom}" class="mark"/>')
        parts.append(f'<text x="{x + 3:.1f}" y="{TOP + 10}" class="mark">{escape(label)}</text>')
    if plot.level is not None:
        y = float(axes.y(plot.level))
        parts.append(f'<line x1="{LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}" class="level"/>')
    return parts


def _legend(names: Sequence[str]) -> list[str]:
    parts: list[str] = []
    x = WIDTH - RIGHT
    for number, name in reversed(list(enumerate(names))):
        parts.append(f'<text x="{x}" y="15" text-anchor="end" fill="{_color(number)}">{escape(name)}</text>')
        x -= 12 + 7 * len(name)
    return parts


def _line(plot: Plot, axes: _Axes, column: int) -> str:
    time_s, values = envelope(plot.time_s, plot.series.values[:, column], WIDTH - LEFT - RIGHT)
    x, y = axes.x(time_s), axes.y(values)
    drawn = np.isfinite(y)
    # A gap in the values lifts the pen.
    pen = ["M" if k == 0 or not drawn[k - 1] else "L" for k in range(len(x))]
    path = "".join(f"{pen[k]}{x[k]:.1f} {y[k]:.1f}" for k in range(len(x)) if drawn[k])
    return f'<path d="{path}" stroke="{_color(column)}"/>' if path else ""


def envelope(
    time_s: NDArray[np.float64], values: NDArray[np.float64], columns: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return at most two points for each of `columns` slices of time: the least and the greatest value, in order.

    No peak is lost, however many points there are.
    """
    if len(values) <= 2 * columns:
        return time_s, values
    edges = np.unique(np.linspace(0, len(values), columns + 1).astype(int))
    kept: list[int] = []
    for first, last in zip(edges[:-1], edges[1:], strict=True):
        part = values[first:last]
        if np.isnan(part).all():
            kept.append(int(first))
            continue
        kept += sorted({int(first + np.nanargmin(part)), int(first + np.nanargmax(part))})
    return time_s[kept], values[kept]


def _color(number: int) -> str:
    return f"#{COLORS[number % len(COLORS)] >> 8:06x}"
