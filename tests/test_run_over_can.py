"""Runs over virtual buses: the same seed puts the same frames on them at the same times."""

from __future__ import annotations

from pathlib import Path

import pytest

from preshape.sim_backend.scenario import Scenario
from preshape.tools.run_options import RunOptions
from preshape.tools.session import run_session


def log_of(seed: int, file: Path) -> list[str]:
    """Run for a second on virtual buses; return the log's lines."""
    options = RunOptions(device="can", time_limit_s=1.0, record=False, pictures=False)
    result = run_session(Scenario(name="bus"), seed, options, bus_log=file)
    assert result.report.loop.refused == 0
    return file.read_text().splitlines()


@pytest.mark.physics
@pytest.mark.bus
def test_the_same_seed_gives_the_same_frames_at_the_same_times_and_another_seed_others(tmp_path: Path) -> None:
    first, again = log_of(3, tmp_path / "first.log"), log_of(3, tmp_path / "again.log")
    assert len(first) > 500 * (4 + 12)
    assert first == again
    assert log_of(4, tmp_path / "other.log") != first
