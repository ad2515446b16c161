"""The areas' benchmark as plain figures: what it cost, how many cases, how many differed from enumeration."""

from __future__ import annotations

import numpy as np

from preshape.tools.bench_areas import AreaBench, bench_areas


def as_figures(bench: AreaBench) -> dict[str, float]:
    """Return counts, and microseconds of CPU time per problem by what was computed."""
    report: dict[str, float] = {"cases": float(bench.cases), "differences": float(len(bench.differences))}
    for name, values in bench.times_us.items():
        stem = name.replace(", ", "_").replace(" ", "_")
        report[f"{stem}_median_us"] = float(np.median(values))
        report[f"{stem}_p99_us"] = float(np.percentile(values, 99))
        report[f"{stem}_max_us"] = max(values)
    return report


def area_figures(count: int = 2_000) -> dict[str, float]:
    """Check and time so many random procedures and boxes; `bench_areas` alone does 10,000 in some minutes."""
    return as_figures(bench_areas(count))
