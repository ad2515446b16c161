"""The bus budget: the worked layouts of the design, the shipped buses, and the refusal of what does not fit."""

from __future__ import annotations

from pathlib import Path

import pytest

from preshape.hal.can.budget import (
    MOST_LOAD,
    BudgetExceeded,
    budgets,
    bus_budget,
    classic_bits,
    classic_us,
    fd_us,
    require_fit,
)
from preshape.hal.can.slices import slice_count
from preshape.hal.can.topology import TOPOLOGY, BusSpec, robot_topology
from preshape.tools.bus_table import COLUMNS, budget_row, layout_row, layouts

MEGA = 1_000_000


def test_a_classic_frame_of_eight_bytes_has_135_bits_at_the_worst() -> None:
    assert classic_bits(8) == 135


@pytest.mark.parametrize(
    ("length", "data_bit_per_s", "us"),
    [(24, 5 * MEGA, 89.6), (24, 8 * MEGA, 68.75), (64, 5 * MEGA, 169.6), (64, 8 * MEGA, 118.75)],
)
def test_an_fd_frame_lasts_as_long_as_worked_out_by_hand(length: int, data_bit_per_s: int, us: float) -> None:
    assert fd_us(length, MEGA, data_bit_per_s) == pytest.approx(us)


@pytest.mark.parametrize(
    ("cycle_us", "expected_us", "load_500", "load_1000"),
    [
        (classic_us(0, MEGA) + 8 * classic_us(8, MEGA), 1135, 0.57, 1.14),
        (26 * classic_us(8, MEGA), 3510, 1.76, 3.51),
        (classic_us(0, MEGA) + 13 * (classic_us(6, MEGA) + classic_us(8, MEGA)), 3305, 1.65, 3.31),
        (fd_us(0, MEGA, 5 * MEGA) + 8 * fd_us(24, MEGA, 5 * MEGA), 757, 0.38, 0.76),
        (fd_us(64, MEGA, 5 * MEGA) + 4 * fd_us(24, MEGA, 5 * MEGA), 528, 0.26, 0.53),
        (fd_us(64, MEGA, 8 * MEGA) + 4 * fd_us(24, MEGA, 8 * MEGA), 394, 0.20, 0.39),
        (26 * fd_us(24, MEGA, 5 * MEGA), 2330, 1.17, 2.33),
    ],
    ids=["classic", "classic per axis", "CiA 402", "FD SYNC", "FD broadcast", "FD broadcast 8M", "FD per axis"],
)
def test_every_layout_of_the_design_table_takes_what_the_table_says(
    cycle_us: float, expected_us: float, load_500: float, load_1000: float
) -> None:
    assert cycle_us == pytest.approx(expected_us, abs=0.5)
    assert cycle_us * 500e-6 == pytest.approx(load_500, abs=0.0055)
    assert cycle_us * 1000e-6 == pytest.approx(load_1000, abs=0.0055)


def test_a_hand_bus_carries_one_broadcast_a_thumb_state_and_three_finger_states() -> None:
    hand = bus_budget(TOPOLOGY.buses[0], 500.0)
    expected_us = fd_us(64, MEGA, 5 * MEGA) + fd_us(32, MEGA, 5 * MEGA) + 3 * fd_us(24, MEGA, 5 * MEGA)
    assert hand.cycle_us == pytest.approx(expected_us)
    assert hand.frames == 5
    assert hand.cycle_us * 500e-6 < hand.load < hand.cycle_us * 500e-6 + 0.01


def test_every_bus_of_the_robot_fits_at_500_hz_and_a_cycle_ends_within_its_period_at_the_worst() -> None:
    for budget in budgets(TOPOLOGY, 500.0):
        assert budget.fits
        assert budget.cycle_us < budget.response_us < budget.worst_us + 200.0 < 2200.0


def test_a_rate_over_the_allowed_load_is_refused_with_the_figure() -> None:
    with pytest.raises(BudgetExceeded, match=r"rate of bus arms: got 1000 Hz, which takes \d+% of it, .* is 80%"):
        require_fit(TOPOLOGY, 1000.0)


def test_the_highest_rate_named_is_where_the_load_reaches_its_bound() -> None:
    for budget in budgets(TOPOLOGY, 500.0):
        bus = next(bus for bus in TOPOLOGY.buses if bus.name == budget.bus)
        assert bus_budget(bus, budget.most_hz).load == pytest.approx(MOST_LOAD)


def test_classic_buses_fit_at_a_lower_rate_and_are_refused_at_500_hz() -> None:
    classic = robot_topology("classic")
    require_fit(classic, 100.0)
    with pytest.raises(BudgetExceeded):
        require_fit(classic, 500.0)


def test_a_classic_payload_costs_its_slices() -> None:
    hand = BusSpec("hand", (TOPOLOGY.groups[0],), "classic")
    frames = slice_count(64) + slice_count(32) + 3 * slice_count(24)
    assert bus_budget(hand, 100.0).cycle_us == pytest.approx(frames * classic_us(8, MEGA))


def test_the_tables_in_the_readme_and_its_page_on_the_bus_are_the_codes() -> None:
    root = Path(__file__).parents[1]
    readme, page = (root / "README.md").read_text(), (root / "docs" / "can.md").read_text()
    for row in (COLUMNS, *(budget_row(budget) for budget in budgets(TOPOLOGY, 500.0))):
        assert f"| {' | '.join(row)} |" in readme and f"| {' | '.join(row)} |" in page
    for layout in layouts():
        assert f"| {' | '.join(layout_row(*layout))} |" in page
