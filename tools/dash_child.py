"""The dashboard of a run: `preshape dash` as a process of its own, which ends with the run."""

from __future__ import annotations

import subprocess
import sys

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.telemetry_config import TelemetryConfig

WITHIN_S = 120.0
"""How long it waits for the run to publish, s."""
CODE = "from preshape.tools.cli import main; main()"


class DashChild:
    """A context manager; what the dashboard has to say goes to standard error."""

    def __init__(self, config: TelemetryConfig) -> None:
        """Watch the robot that publishes by this configuration.

        Raises:
            ConfigurationError: where it publishes is in a Zenoh configuration file, which says nothing to a viewer.
        """
        if config.zenoh_config is not None:
            raise ConfigurationError(
                "--dashboard: got a zenoh_config, allowed is an endpoint; start `preshape dash --zenoh-config FILE`"
            )
        where = ["--robot", config.robot, "--endpoint", config.endpoint, "--within-s", str(WITHIN_S)]
        self._process = subprocess.Popen([sys.executable, "-c", CODE, "dash", *where], stdout=sys.stderr)

    def close(self) -> None:
        """End it; may be called twice."""
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait()

    def __enter__(self) -> DashChild:
        return self

    def __exit__(self, *cause: object) -> None:
        self.close()
