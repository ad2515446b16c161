"""The controller of a recording, as it was or with some of its parameters changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from preshape.hal.recording import Recording
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.controller_setup import ControllerSetup, decode_setup
from preshape.tools.overrides import apply_overrides


def recorded_setup(recording: Recording, overrides: Sequence[str] = ()) -> ControllerSetup:
    """Return what the recorded controller was made from; `overrides` are texts `table.field=value`.

    Raises:
        ConfigurationError: a field that does not exist, a value that it does not allow, or a file that is not ours.
    """
    recorded = msgspec.json.decode(recording.setup)
    tables = apply_overrides(recorded, overrides)
    _check_known(recorded, tables)
    try:
        return decode_setup(msgspec.json.encode(tables))
    except (msgspec.ValidationError, ValueError) as error:
        what = "--set" if overrides else "recording"
        raise ConfigurationError(f"{what}: {error}") from error


def _check_known(recorded: Mapping[str, Any], changed: Mapping[str, Any], above: str = "") -> None:
    """Refuse a field that the recorded set-up does not have: it would change nothing."""
    for name, value in changed.items():
        if name not in recorded:
            raise ConfigurationError(f"--set {above}{name}: unknown key, allowed are {', '.join(recorded)}")
        if isinstance(value, dict) and isinstance(recorded[name], dict):
            _check_known(recorded[name], value, f"{above}{name}.")
