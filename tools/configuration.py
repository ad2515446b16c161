"""Scenario files: TOML into strict types, with errors that name file, field, value and what is allowed."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from preshape.sim_backend.scenario import Scenario
from preshape.tools.configuration_error import ConfigurationError


def shipped_scenarios() -> dict[str, Path]:
    """Return the scenario files that come with the package, by name."""
    folder = Path(str(resources.files("preshape.sim_backend"))) / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def scenario_file(name: str) -> Path:
    """Return the file that a path, or the name of a shipped scenario, means."""
    return Path(name) if name.endswith(".toml") else shipped_scenarios().get(name, Path(name))


def load_scenario(name: str, overrides: Sequence[str] = ()) -> Scenario:
    """Return the scenario in a file, with overrides `table.field=value` set."""
    file = scenario_file(name)
    try:
        tables: dict[str, Any] = tomllib.loads(file.read_text("utf-8"))
    except OSError as error:
        raise ConfigurationError(f"{file}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{file}: not TOML: {error}") from error
    try:
        return msgspec.convert(tables, Scenario)
    except msgspec.ValidationError as error:
        raise ConfigurationError(f"{file}: {error}") from error
