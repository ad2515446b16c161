"""What the field alone does: `python -m preshape.tools.bench_approach`, a hand from random starts among random posts.

The right hand starts anywhere around its pre-grasp of the standing tea box, tilted, its fingers anyhow, with posts on
the table along its way. Every variant of the field gets the same starts. Nothing says that a start has a way that the
field can find: what counts is how the variants differ.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from preshape.control.field import FieldOptions
from preshape.tools.field_flight import FieldFlight, fly
from preshape.tools.random_approach import random_approach

VARIANTS: dict[str, FieldOptions] = {
    "grouped, smooth ties, L2 (default)": FieldOptions(),
    "summed over all boxes": FieldOptions(mode="summed"),
    "hard tie sets": FieldOptions(ties="hard"),
    "L1 distance": FieldOptions(norm="l1"),
}


@dataclass(frozen=True, slots=True)
class ApproachBench:
    """What every variant came to, flight by flight, on the same starts."""

    seed: int
    flights: dict[str, list[FieldFlight]]

    def lines(self) -> list[str]:
        """Return the report, line by line."""
        count = len(next(iter(self.flights.values())))
        lines = [f"{count} random starts, seed {self.seed}"]
        lines.append(f"{'':36s} reached   touched   stalled  timed out   s, median   p90   least gap, mm, median")
        for name, flights in self.flights.items():
            ends = Counter(flight.end for flight in flights)
            touched = sum(flight.least_gap_m < 0.0 for flight in flights)
            clean = [flight for flight in flights if flight.end == "reached" and flight.least_gap_m >= 0.0]
            seconds = [flight.seconds for flight in clean] or [np.nan]
            gap = float(np.median([1e3 * flight.least_gap_m for flight in clean] or [np.nan]))
            p50, p90 = np.percentile(seconds, [50, 90])
            lines.append(
                f"{name:36s} {len(clean):7d} {touched:9d} {ends['stalled']:9d} {ends['timed out']:10d} {p50:11.2f} "
                f"{p90:5.2f} {gap:24.1f}"
            )
        return [*lines, "reached: without touching anything; seconds and gap are theirs"]


def bench_approach(count: int = 200, seed: int = 5, told: Callable[[int], None] = lambda done: None) -> ApproachBench:
    """Fly all variants from `count` random starts; `told` hears how many are done."""
    rng = np.random.default_rng(seed)
    bench = ApproachBench(seed, {name: [] for name in VARIANTS})
    for number in range(count):
        made = random_approach(rng)
        for name, options in VARIANTS.items():
            bench.flights[name].append(fly(made, options))
        told(number + 1)
    return bench


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m preshape.tools.bench_approach", description=__doc__)
    parser.add_argument("--starts", type=int, default=200, help="random starts; default: %(default)s")
    parser.add_argument("--seed", type=int, default=5, help="of the starts; default: %(default)s")
    options = parser.parse_args()
    if options.starts < 1:
        parser.error(f"--starts: got {options.starts}, allowed is >= 1")

    def told(done: int) -> None:
        if done % 20 == 0:
            print(f"{done} of {options.starts} starts", file=sys.stderr, flush=True)

    print("\n".join(bench_approach(options.starts, options.seed, told).lines()))


if __name__ == "__main__":
    main()
