"""How fast and how patient a run is by its world, and what of it may be asked for."""

from __future__ import annotations

from typing import Any

import pytest

from preshape.tools.command_serve import Options as ServeOptions
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.run_options import PATIENCE, STALLING_PATIENCE, RunOptions

CAN_PACED: dict[str, Any] = {"device": "can", "paced": True}
CAN_ATTACHED: dict[str, Any] = {"device": "can", "attach": True, "interface": "socketcan"}


@pytest.mark.parametrize(
    ("how", "rate_hz", "patience"),
    [
        ({}, 500, PATIENCE),
        ({"paced": True}, 500, STALLING_PATIENCE),
        ({"device": "can"}, 500, PATIENCE),
        (CAN_PACED, 250, STALLING_PATIENCE),
        (CAN_ATTACHED, 250, PATIENCE),
        ({"device": "zenoh"}, 250, PATIENCE),
    ],
)
def test_rate_and_patience_follow_the_world_until_they_are_given(
    how: dict[str, Any], rate_hz: int, patience: int
) -> None:
    options = RunOptions(**how)
    assert (options.loop_rate_hz, options.patience) == (rate_hz, patience)
    given = RunOptions(**how, rate_hz=100, patience_cycles=7)
    assert (given.loop_rate_hz, given.patience) == (100, 7)


def test_a_run_over_zenoh_goes_at_the_rate_of_what_is_served_if_neither_is_given() -> None:
    assert ServeOptions().run.loop_rate_hz == RunOptions(device="zenoh").loop_rate_hz


@pytest.mark.parametrize("how", [{}, {"device": "can"}, CAN_ATTACHED, {"device": "zenoh"}])
def test_slow_motion_is_for_worlds_that_the_run_simulates_in_real_time(how: dict[str, Any]) -> None:
    with pytest.raises(ConfigurationError, match="--pace: got 0.5 for a world of another's or in lockstep, allowed is"):
        RunOptions(**how, pace=0.5)
    assert RunOptions(**CAN_PACED, pace=0.5).pace == RunOptions(paced=True, pace=0.5).pace == 0.5


@pytest.mark.parametrize("pace", [0.0, -1.0, 1.5, float("nan")])
def test_a_pace_out_of_range_is_refused(pace: float) -> None:
    with pytest.raises(ConfigurationError, match="--pace: got .* allowed is > 0 and <= 1"):
        RunOptions(paced=True, pace=pace)


def test_a_rate_whose_period_is_no_whole_number_of_steps_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="--rate-hz: got 300, allowed are 20, 25"):
        RunOptions(rate_hz=300)
