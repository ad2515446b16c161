"""What a plan costs: random places of the tea box, standing and lying, and random openings."""

from __future__ import annotations

import json

import numpy as np

from preshape.hal.world import Face
from preshape.sim_backend.scenario import BoxSection, OpeningSection, Scenario, edges_of
from preshape.tools.planned_task import PlannedTask, plan_task

WARM_UP = 4
REST_FACES: tuple[Face, ...] = ("-z", "-z", "-z", "-x")
"""On what the box rests: three in four stand."""


def random_scenario(rng: np.random.Generator) -> Scenario:
    """Draw a tea box within 50 mm of its place, any yaw, standing or lying, the opening on either wide face.

    The opening's edge is either of the face's long ones, its offset within 10 mm of the middle.
    """
    place = (0.55 + float(rng.uniform(-0.05, 0.05)), -0.30 + float(rng.uniform(-0.05, 0.05)))
    rest = REST_FACES[int(rng.integers(len(REST_FACES)))]
    box = BoxSection(position_m=place, yaw_deg=float(rng.uniform(-180.0, 180.0)), rest_face=rest)
    face: Face = "+x" if rng.random() < 0.5 else "-x"
    edge = edges_of(box.size_m, face)[int(rng.integers(2))]
    opening = OpeningSection(face=face, edge=edge, offset_m=float(rng.uniform(-0.01, 0.01)))
    return Scenario(name="bench", box=box, opening=opening)


def bench_plan(plans: int = 200, seed: int = 5) -> dict[str, float]:
    """Return times in ms: of the plan for all five tasks before the opening is known, of the one after it is found.

    `both` is the sum of the two, each planned for the first time in its scene. A few plans before the run load compiled
    code and are not counted. `without_plan` counts scenes that end with a certificate.
    """
    rng = np.random.default_rng(seed)
    for _ in range(WARM_UP):
        plan_task(random_scenario(rng), again=False)
    tasks = [plan_task(random_scenario(rng), again=False) for _ in range(plans)]
    figures = {"plans": float(plans), "without_plan": float(sum(not task.feasible for task in tasks))}
    for name, times in _times(tasks).items():
        figures[f"{name}_median_ms"] = float(np.median(times))
        figures[f"{name}_p99_ms"] = float(np.percentile(times, 99))
        figures[f"{name}_max_ms"] = float(np.max(times))
    return figures


def _times(tasks: list[PlannedTask]) -> dict[str, list[float]]:
    both = [task for task in tasks if task.after is not None]
    return {
        "before": [task.time_ms["before"] for task in tasks],
        "after": [task.time_ms["after"] for task in both],
        "both": [task.time_ms["before"] + task.time_ms["after"] for task in both],
    }


if __name__ == "__main__":
    print(json.dumps(bench_plan(), indent=1))
