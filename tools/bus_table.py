"""The hand bus' budget as rows: what its buses carry at a rate, beside the layouts that were weighed against it."""

from __future__ import annotations

from collections.abc import Sequence

from preshape.hal.can.budget import MOST_LOAD, BusBudget, classic_us, fd_us

COLUMNS = ("bus", "frames", "cycle, us", "load", "worst case, us", "response, us", "at most, Hz")
MEGA = 1_000_000


def budget_row(budget: BusBudget) -> tuple[str, ...]:
    """Return a bus' figures as text, in the order of `COLUMNS`."""
    load = f"{budget.load:.0%}" if budget.fits else f"{budget.load:.0%}, allowed {MOST_LOAD:.0%}"
    times = (f"{value:.0f}" for value in (budget.worst_us, budget.response_us, budget.most_hz))
    return budget.bus, str(budget.frames), f"{budget.cycle_us:.0f}", load, *times


def layouts() -> Sequence[tuple[str, float]]:
    """Return the layouts of one hand (13 actuators on 4 modules) that were weighed, and what a cycle takes, us."""
    return (
        ("classic: SYNC + 4 commands + 4 positions", classic_us(0, MEGA) + 8 * classic_us(8, MEGA)),
        ("classic: one frame per actuator each way", 26 * classic_us(8, MEGA)),
        ("classic CiA 402, 13 axes", classic_us(0, MEGA) + 13 * (classic_us(6, MEGA) + classic_us(8, MEGA))),
        ("FD 1/5: SYNC + 4 x 24 B + 4 x 24 B", fd_us(0, MEGA, 5 * MEGA) + 8 * fd_us(24, MEGA, 5 * MEGA)),
        ("FD 1/5: one 64 B broadcast + 4 x 24 B states", fd_us(64, MEGA, 5 * MEGA) + 4 * fd_us(24, MEGA, 5 * MEGA)),
        ("the same at 1/8", fd_us(64, MEGA, 8 * MEGA) + 4 * fd_us(24, MEGA, 8 * MEGA)),
        ("FD 1/5: one frame per axis each way, 24 B", 26 * fd_us(24, MEGA, 5 * MEGA)),
    )


def layout_row(name: str, cycle_us: float) -> tuple[str, ...]:
    """Return a layout's figures as text: name, cycle, loads at 500 Hz and at 1 kHz."""
    return name, f"{cycle_us:.0f}", f"{cycle_us * 500e-6:.0%}", f"{cycle_us * 1000e-6:.0%}"
