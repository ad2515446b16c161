"""Which benchmarks there are, where each lives, and what its figures must be. Imports nothing heavy."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, cast

Figures = Mapping[str, float]
UNITS = ("us_per_pair", "us", "ms", "mm", "rad", "share")
"""Units that figures' names may end in; what is a ratio or a count has none."""


@dataclass(frozen=True, slots=True)
class Bar:
    """What a figure must be at least or at most."""

    kind: Literal[">=", "<="]
    value: float

    def met(self, figure: float) -> bool:
        """Return whether a figure is on the right side; NaN never is."""
        return figure >= self.value if self.kind == ">=" else figure <= self.value

    def __str__(self) -> str:
        return f"{self.kind} {self.value:g}"


@dataclass(frozen=True, slots=True)
class Bench:
    """One benchmark: module and function in `preshape.tools`, what it measures, and bars by figure."""

    module: str
    function: str
    summary: str
    bars: Mapping[str, Bar]

    def run(self) -> Figures:
        """Import and run it; figures by name."""
        function = cast(Callable[[], Figures], getattr(importlib.import_module(self.module), self.function))
        return function()


BENCHES: dict[str, Bench] = {
    "tick": Bench(
        "preshape.tools.bench_tick",
        "bench_tick",
        "one control tick of both arms and hands, stage by stage",
        {"tick_us": Bar("<=", 900.0), "telemetry_us": Bar("<=", 15.0), "scipy_lp_over_l1": Bar(">=", 1000.0)},
    ),
    "telemetry": Bench(
        "preshape.tools.bench_telemetry",
        "bench_telemetry",
        "what telemetry costs a tick with 0, 1 and 10 subscribers (one stopped, one slow), and what they get",
        {
            **{f"tick_{count}_subscribers_us": Bar("<=", 15.0) for count in (0, 1, 10)},
            "compute_p50_ratio": Bar("<=", 1.10),
            "compute_p99_ratio": Bar("<=", 1.20),
            "live_subscribers": Bar(">=", 8.0),
            "events_missing": Bar("<=", 0.0),
            "states_lost_share": Bar("<=", 0.001),
        },
    ),
    "distances": Bench(
        "preshape.tools.bench_distances",
        "bench_distances",
        "box distances beside scipy's LP and mj_geomDistance",
        {"scipy_lp_over_l1": Bar(">=", 1000.0)},
    ),
    "field": Bench(
        "preshape.tools.bench_field", "bench_field", "the field of both hands, every switch, far and near", {}
    ),
    "preshape": Bench(
        "preshape.tools.bench_preshape",
        "bench_preshape",
        "the preshape QP on random boxes",
        {"solved_share": Bar(">=", 0.99), "kkt_share": Bar(">=", 1.0), "median_ms": Bar("<=", 3.0)},
    ),
    "plan": Bench(
        "preshape.tools.bench_plan",
        "bench_plan",
        "the plan of all five tasks, before and after the opening is found",
        {
            f"{when}_{figure}_ms": Bar("<=", bar)
            for when in ("before", "after")
            for figure, bar in (("median", 50.0), ("p99", 250.0))
        },
    ),
    "bus": Bench(
        "preshape.tools.bench_bus",
        "bench_bus",
        "one cycle of both hands over virtual CAN FD, encode to decode, beside bare python-can",
        {"cycle_us": Bar("<=", 200.0)},
    ),
    "areas": Bench(
        "preshape.tools.area_figures",
        "area_figures",
        "areas and regrasps on random procedures, against enumeration",
        {
            "differences": Bar("<=", 0.0),
            **{
                f"{what}_{reading}_max_us": Bar("<=", 1000.0)
                for what in ("areas", "fewest_regrasps")
                for reading in ("literal", "committed")
            },
        },
    ),
}


def unit_of(name: str) -> str:
    """Return the unit that a figure's name ends in, or an empty text."""
    unit = next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")
    return {"us_per_pair": "us a pair", "share": "of 1"}.get(unit, unit)
