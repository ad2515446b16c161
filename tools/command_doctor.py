"""`preshape doctor`: this machine, its packages, the hand bus, and what the holding grip bears of what opening asks."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.exit_codes import ExitCode
from preshape.tools.run_options import RATES_HZ, ProfileName

if TYPE_CHECKING:
    from rich.console import Console

    from preshape.hal.can.budget import BusBudget
    from preshape.tools.holding_check import Holding

SCHEMA = "preshape/doctor/1"
WIDTH = 120
NOTE = """\
push: the thumb on the tab; pull: outward on the lid at the hole's inner rim; lever: the same pull with its opposite
on the side wall's edge. A cell: what the grip bears with its driven joints at their holding torques / with all at
their torque limits, and the verdict. Upper bounds: contacts from the grip's geometry, the best inner forces that
friction, torques and the crush load allow, the box turned in the worst way about its horizontal axis."""


BUS_NOTE = """\
cycle: broadcasts and states; load: cycles and heartbeats; worst case: a cycle into which a quick stop, every module's
emergency and heartbeat and a parameter exchange fall at once; response: from the broadcast until the last state, at
the worst."""

EXAMPLES = (
    ("preshape doctor", "this machine and the tea box"),
    ("preshape doctor --rate-hz 250 --profile classic --json", "buses without FD, for a program"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Show this machine, its packages, what the hand bus carries, and what the holding grip bears of what is asked.

    Exit code 1 when a package is missing, a bus cannot carry its frames at the rate, or no grip suits the box.

    Attributes:
        scenario: the box to be opened: a scenario's TOML file, or the name of a shipped one.
        rate_hz: of the hand bus.
        profile: of the hand bus: CAN FD frames, or classic ones.
        json: print one JSON object instead of tables.
        overrides: a scenario field to be set, as table.field=value; may be given several times.
    """

    scenario: str = "tea_box"
    rate_hz: int = 500
    profile: ProfileName = "fd"
    json: bool = False
    overrides: Annotated[
        tuple[str, ...], tyro.conf.arg(name="set", metavar="TABLE.FIELD=VALUE"), tyro.conf.UseAppendAction
    ] = ()

    def __post_init__(self) -> None:
        if self.rate_hz not in RATES_HZ:
            raise ConfigurationError(f"--rate-hz: got {self.rate_hz}, allowed are {', '.join(map(str, RATES_HZ))}")


def execute(options: Options) -> int:
    """Print the findings; return the exit code."""
    from preshape.hal.can.budget import budgets
    from preshape.hal.can.topology import robot_topology
    from preshape.tools.configuration import load_scenario
    from preshape.tools.holding_check import holding_check
    from preshape.tools.machine import machine, packages

    scenario = load_scenario(options.scenario, options.overrides)
    facts, versions = machine(), packages()
    buses = budgets(robot_topology(options.profile), options.rate_hz)
    holdings: list[Holding] = []
    no_grip = ""
    try:
        holdings = holding_check(scenario)
    except ValueError as error:
        no_grip = f"no grip holds the box of {scenario.name} with its opening face free: {error}"
    if options.json:
        print(as_json(facts, versions, buses, scenario.name, holdings, no_grip))
    else:
        _print_facts(facts, versions)
        _print_buses(buses, options)
        _print_holdings(scenario.name, holdings, no_grip)
    amiss = no_grip or "missing" in versions.values() or not all(bus.fits for bus in buses)
    return ExitCode.TASK_FAILED if amiss else ExitCode.DONE


def as_json(
    facts: Mapping[str, str],
    versions: Mapping[str, str],
    buses: Sequence[BusBudget],
    scenario: str,
    holdings: Sequence[Holding],
    no_grip: str,
) -> str:
    """Return everything as one JSON object."""
    content = {
        "schema": SCHEMA,
        "machine": facts,
        "packages": versions,
        "buses": [{**asdict(bus), "fits": bus.fits} for bus in buses],
        "scenario": scenario,
        "holding": [{**asdict(holding), "verdict": holding.verdict} for holding in holdings],
        "no_grip": no_grip or None,
    }
    return json.dumps(content, indent=2)


def _print_facts(facts: Mapping[str, str], versions: Mapping[str, str]) -> None:
    from rich.table import Table

    table = Table(title="this machine", title_justify="left", show_header=False)
    for name, fact in facts.items():
        table.add_row(name, fact)
    table.add_section()
    for name, version in versions.items():
        table.add_row(name, version)
    _console().print(table)


def _print_buses(buses: Sequence[BusBudget], options: Options) -> None:
    from rich.table import Table

    from preshape.tools.bus_table import COLUMNS, budget_row

    title = f"hand bus, {options.profile} frames, at {options.rate_hz} Hz; worst-case stuffing"
    table = Table(title=title, title_justify="left")
    for column in COLUMNS:
        table.add_column(column, justify="left" if column == COLUMNS[0] else "right")
    for bus in buses:
        table.add_row(*budget_row(bus))
    console = _console()
    console.print(table)
    console.print(BUS_NOTE, highlight=False)


def _print_holdings(scenario: str, holdings: Sequence[Holding], no_grip: str) -> None:
    from rich.table import Table

    if no_grip:
        _console().print(no_grip, highlight=False, markup=False)
        return
    frictions = sorted({holding.friction for holding in holdings})
    table = Table(title=f"{scenario}: what the grip at one end bears beside what opening asks, N", title_justify="left")
    for column in ("load", "strengths", "asked", *(f"at friction {friction:g}" for friction in frictions)):
        table.add_column(column)
    for load in dict.fromkeys(holding.load for holding in holdings):
        for scale in sorted({holding.scale for holding in holdings}):
            row = [holding for holding in holdings if (holding.load, holding.scale) == (load, scale)]
            cells = (f"{held.held_n:.1f} / {held.limit_n:.1f}  {held.verdict}" for held in row)
            table.add_row(load, f"x{scale:g}", f"{row[0].demand_n:.1f}", *cells)
        table.add_section()
    console = _console()
    console.print(table)
    console.print(NOTE, highlight=False)


def _console() -> Console:
    """Return a console of the terminal's width, or of a fixed one where there is no terminal."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal else Console(width=WIDTH)
