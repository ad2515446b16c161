"""`preshape status`: how a running robot is: rates, ages, jitter, overruns, buses, temperatures."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.exit_codes import ExitCode

if TYPE_CHECKING:
    import zenoh

    from preshape.tools.telemetry_keys import Keys

REFRESH_S = 0.5
"""Time between two looks at the robot, s."""

EXAMPLES = (
    ("preshape status", "a live table of a robot that runs with --telemetry"),
    ("preshape status --json", "once, for a program"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Show how a running robot is (`preshape run --telemetry`): a live table on a terminal, one table elsewhere.

    Attributes:
        robot: the robot's id.
        endpoint: where its telemetry listens, as Zenoh writes it.
        zenoh_config: a Zenoh configuration file (JSON5, JSON or YAML) in place of the endpoint.
        json: print the status as one JSON object.
        seconds: how long to watch on a terminal; 0 is until Ctrl-C.
    """

    robot: str = "box"
    endpoint: str = "tcp/127.0.0.1:7447"
    zenoh_config: Path | None = None
    json: bool = False
    seconds: float = 0.0

    def __post_init__(self) -> None:
        if not self.seconds >= 0.0:
            raise ConfigurationError(f"--seconds: got {self.seconds:g}, allowed is >= 0")


def execute(options: Options) -> int:
    """Ask and print; return the exit code."""
    from preshape.tools.status_client import ask_status
    from preshape.tools.telemetry_keys import Keys
    from preshape.tools.telemetry_messages import encode_message
    from preshape.tools.zenoh_session import client_settings, open_session

    keys = Keys(options.robot)
    with open_session(client_settings(options.endpoint), options.zenoh_config) as session:
        if options.json:
            print(encode_message(ask_status(session, keys)).decode())
        elif sys.stdout.isatty():
            _watch(session, keys, options.seconds)
        else:
            _print_once(session, keys)
    return ExitCode.DONE


def _print_once(session: zenoh.Session, keys: Keys) -> None:
    from rich.console import Console

    from preshape.tools.status_client import ask_status
    from preshape.tools.status_table import status_table

    Console(width=140).print(status_table(ask_status(session, keys)))


def _watch(session: zenoh.Session, keys: Keys, seconds: float) -> None:
    """Show the table anew until the time is up, or Ctrl-C; say so while there is no answer."""
    from rich.live import Live

    from preshape.hal.device import DeviceUnreachable
    from preshape.tools.status_client import ask_status
    from preshape.tools.status_table import status_table

    until = time.monotonic() + seconds if seconds else float("inf")
    with Live(status_table(ask_status(session, keys)), auto_refresh=False) as live:
        while time.monotonic() < until:
            time.sleep(REFRESH_S)
            try:
                live.update(status_table(ask_status(session, keys)), refresh=True)
            except DeviceUnreachable as silence:
                live.update(str(silence), refresh=True)
