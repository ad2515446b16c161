"""Scenario files: TOML into strict types; every error names file, field, value and what is allowed."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from preshape.sim_backend.scenario import Scenario
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.overrides import apply_overrides
from preshape.tools.scenario_checks import first_objection
from preshape.tools.scenario_schema import explained


def shipped_scenarios() -> dict[str, Path]:
    """Return the scenario files that come with the package, by name."""
    folder = Path(str(resources.files("preshape.sim_backend"))) / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def scenario_file(name: str) -> Path:
    """Return the file that a path, or the name of a shipped scenario, means."""
    shipped = shipped_scenarios()
    if name in shipped:
        return shipped[name]
    if not name.endswith(".toml") and not Path(name).exists():
        raise ConfigurationError(f"--scenario: got {name!r}, allowed are a .toml file or {', '.join(shipped)}")
    return Path(name)


def load_scenario(name: str, overrides: Sequence[str] = ()) -> Scenario:
    """Return the scenario, not drawn, that a file or the name of a shipped one holds.

    `overrides` are texts `table.field=value`; one of a quantity that the seed would draw drops its draw.

    Raises:
        ConfigurationError: unreadable, unknown key, wrong type, out of range, or fields that contradict each other.
    """
    file = scenario_file(name)
    tables = apply_overrides(read_tables(file), overrides)
    try:
        return checked_scenario(tables)
    except ConfigurationError as error:
        raise ConfigurationError(f"{file}: {error}") from error


def read_tables(file: Path) -> dict[str, Any]:
    """Return a TOML file's content; `ConfigurationError` if it cannot be read or is no TOML."""
    try:
        return tomllib.loads(file.read_text("utf-8"))
    except OSError as error:
        raise ConfigurationError(f"{file}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{file}: not text in UTF-8: byte {error.start}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{file}: not TOML: {error}") from error


def checked_scenario(tables: dict[str, Any]) -> Scenario:
    """Return the scenario of tables as TOML gives them; `ConfigurationError` names what is wrong with them."""
    try:
        scenario = msgspec.convert(tables, Scenario)
    except msgspec.ValidationError as error:
        raise ConfigurationError(explained(error, tables, Scenario)) from error
    objection = first_objection(scenario)
    if objection:
        raise ConfigurationError(objection)
    return scenario
