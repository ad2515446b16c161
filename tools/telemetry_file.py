"""Telemetry's configuration file: TOML into strict types; every error names file, field, value and what is allowed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from preshape.tools.configuration import read_tables
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.scenario_schema import explained
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.telemetry_keys import check_name


def load_telemetry(file: Path | None) -> TelemetryConfig:
    """Return the configuration in a TOML file; the defaults without one.

    Raises:
        ConfigurationError: unreadable, unknown key, wrong type or out of range; the line names file, field and value.
    """
    return TelemetryConfig() if file is None else _checked(read_tables(file), file)


def _checked(tables: dict[str, Any], file: Path) -> TelemetryConfig:
    try:
        config = msgspec.convert(tables, TelemetryConfig)
    except msgspec.ValidationError as error:
        raise ConfigurationError(f"{file}: {explained(error, tables, TelemetryConfig)}") from error
    try:
        check_name(config.robot, "robot")
    except ConfigurationError as error:
        raise ConfigurationError(f"{file}: {error}") from error
    if config.zenoh_config is None:
        return config
    # A path in a file counts from that file.
    beside = file.parent / config.zenoh_config
    if not beside.is_file():
        raise ConfigurationError(f"{file}: zenoh_config: got {config.zenoh_config!r}, which is no file")
    return msgspec.structs.replace(config, zenoh_config=str(beside))
