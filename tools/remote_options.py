"""Where a served device is found. Imports nothing heavy: the command line reads it for its help."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoteOptions:
    """Where a served device is found, by those who serve it and those who use it.

    Attributes:
        robot: the id in every key.
        endpoint: where the server listens, as Zenoh writes it.
        zenoh_config: a Zenoh configuration file (JSON5, JSON or YAML) in place of the endpoint.
    """

    robot: str = "box"
    endpoint: str = "tcp/127.0.0.1:7448"
    zenoh_config: Path | None = None
