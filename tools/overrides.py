"""Scenario fields set on the command line: `table.field=value`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

from preshape.tools.configuration_error import ConfigurationError

DRAWN_BY: Mapping[str, tuple[str, ...]] = {
    "box.position_m": ("position_m",),
    "box.yaw_deg": ("yaw_deg",),
    "box.friction": ("friction",),
    "box.mass_kg": ("mass_kg",),
    "opening.offset_m": ("offset_m",),
    "opening.face": ("faces",),
    "opening.edge": ("edges",),
    "disturbances.frozen": ("frozen_parts",),
}
"""Field -> the draws that would change it: they are dropped when it is set, unless they are set, too."""


def apply_overrides(tables: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Return the tables with all overrides set; `ConfigurationError` for one that cannot be.

    A value is TOML; what is no TOML is taken as text, so that `opening.face=+x` needs no quotes. Whether the
    field exists and the value fits is the schema's to say.
    """
    out = deepcopy(dict(tables))
    pairs = [_split(override) for override in overrides]
    given = {path for path, _ in pairs}
    for path, value in pairs:
        _set(out, path, value)
        for draw in DRAWN_BY.get(path, ()):
            if f"draw.{draw}" not in given and isinstance(out.get("draw"), dict):
                out["draw"].pop(draw, None)
    return out


def _split(override: str) -> tuple[str, Any]:
    path, equals, text = override.partition("=")
    path = path.strip()
    if not equals or not all(path.split(".")):
        raise ConfigurationError(f"--set: got {override!r}, allowed is TABLE.FIELD=VALUE")
    return path, _value(text.strip())


def _value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _set(tables: dict[str, Any], path: str, value: Any) -> None:
    *parents, last = path.split(".")
    here: Any = tables
    for depth, key in enumerate(parents):
        if isinstance(here, dict):
            here = here.setdefault(key, {})
        else:
            here = here[_index(here, key, ".".join(parents[: depth + 1]))]
    if isinstance(here, dict):
        here[last] = value
    else:
        here[_index(here, last, path)] = value


def _index(values: Any, key: str, path: str) -> int:
    """Return a list's index; `ConfigurationError` if there is no such place."""
    if not isinstance(values, list):
        raise ConfigurationError(f"--set {path}: there is no table above it, but {values!r}")
    if not key.isdecimal() or int(key) >= len(values):
        raise ConfigurationError(f"--set {path}: got place {key}, allowed is 0 .. {len(values) - 1}")
    return int(key)
