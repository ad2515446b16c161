"""`preshape bench`: what the parts cost on this machine, each beside something to compare it with."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import tyro

from preshape.tools.bench_table import BENCHES, Bench, Figures, unit_of
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.exit_codes import ExitCode

EXAMPLES = (
    ("preshape bench", "everything, beside its bars"),
    ("preshape bench tick bus --json", "two of them, for a program"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Measure parts of preshape on this machine; exit code 1 when a figure misses its bar.

    Attributes:
        names: which benchmarks (default: all of them).
        json: print one JSON object instead of tables.
    """

    names: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    json: bool = False


def missed(bench: Bench, figures: Figures) -> list[str]:
    """Return the names of the figures that miss their bars; a figure that is absent was not measured."""
    return [name for name, bar in bench.bars.items() if name in figures and not bar.met(figures[name])]


def as_json(results: Mapping[str, Figures]) -> str:
    """Return all figures, bars and misses as one JSON object."""
    return json.dumps(
        {
            name: {
                "figures": dict(figures),
                "bars": {figure: str(bar) for figure, bar in BENCHES[name].bars.items()},
                "missed": missed(BENCHES[name], figures),
            }
            for name, figures in results.items()
        },
        indent=2,
    )


def execute(options: Options) -> int:
    """Run the benchmarks named, print what they found, and say by the exit code whether all bars were met."""
    for name in options.names:
        if name not in BENCHES:
            raise ConfigurationError(f"benchmark: got {name!r}, allowed are {', '.join(BENCHES)}")
    results: dict[str, Figures] = {}
    for name in options.names or tuple(BENCHES):
        if not options.json:
            print(f"measuring {name}: {BENCHES[name].summary} ...", file=sys.stderr, flush=True)
        results[name] = BENCHES[name].run()
        if not options.json:
            _print_table(name, BENCHES[name], results[name])
    if options.json:
        print(as_json(results))
    return ExitCode.TASK_FAILED if any(missed(BENCHES[name], f) for name, f in results.items()) else ExitCode.DONE


def _print_table(name: str, bench: Bench, figures: Figures) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=f"{name}: {bench.summary}", title_justify="left")
    table.add_column("figure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    table.add_column("bar")
    out = missed(bench, figures)
    for figure, value in figures.items():
        unit = unit_of(figure)
        bar = f"{bench.bars[figure]}: {'missed' if figure in out else 'met'}" if figure in bench.bars else ""
        table.add_row(figure, f"{value:,.4g}" if abs(value) < 1000 else f"{value:,.0f}", unit, bar)
    Console().print(table)
