"""Where a run's files go, and writing them."""

from __future__ import annotations

import time
from pathlib import Path

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.report import encode_report
from preshape.tools.run_result import RunResult


def choose_directory(out: Path | None, scenario: str, seed: int) -> Path:
    """Return the folder for a run's files, made if missing: `out`, or runs/<time>-<scenario>-<seed>.

    Raises:
        ConfigurationError: it cannot be made.
    """
    directory = out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{scenario}-{seed}"
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"--out {directory}: {error.strerror}") from error
    return directory


def write_run(result: RunResult, directory: Path) -> list[Path]:
    """Write everything that a run has kept and return the files, the report first."""
    report = directory / "report.json"
    report.write_bytes(encode_report(result.report))
    files = [report]
    evidence = result.evidence
    if evidence is not None and evidence.recording is not None:
        files.append(evidence.recording.write(directory / "recording.rrd"))
    return files
