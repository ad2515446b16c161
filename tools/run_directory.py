"""Where a run's files go, and writing them."""

from __future__ import annotations

import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from preshape.sim_backend.judged import judged
from preshape.sim_backend.scene import build_scene
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.evidence import Evidence
from preshape.tools.plan_picture import plan_picture
from preshape.tools.raster import Picture, save_png
from preshape.tools.report import encode_report
from preshape.tools.report_html import report_page
from preshape.tools.run_result import RunResult
from preshape.tools.storyboard import INNER_FRAMES, LIFT_INNER_FRAMES, pick_frames
from preshape.tools.storyboard_picture import TASK_NAMES, storyboard_picture

CLOSING_PHASES = {4: "crush"}
"""The picture of task 4 is the crush, not the hand that has left the box again."""


@contextmanager
def run_directory(out: Path | None, scenario: str, seed: int) -> Generator[Path]:
    """Give the folder for a run's files, made if missing: `out`, or runs/<time>-<scenario>-<seed>.

    When the run ends by an exception and has written nothing, a folder that was made for it goes with it.

    Raises:
        ConfigurationError: it cannot be made.
    """
    directory = out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{scenario}-{seed}"
    made = not directory.exists()
    make_directory(directory)
    try:
        yield directory
    except BaseException:
        if made:
            # Refused for a folder that holds something.
            with suppress(OSError):
                directory.rmdir()
        raise


def make_directory(directory: Path) -> Path:
    """Return a folder, made if missing; `ConfigurationError` if it cannot be made."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"--out {directory}: cannot be made: {error.strerror}") from error
    return directory


def write_run(result: RunResult, directory: Path) -> dict[str, Path]:
    """Write report.json and what was kept: plan.png, storyboard.png; then report.html. Return all."""
    files = {"report": directory / "report.json"}
    files["report"].write_bytes(encode_report(result.report))
    evidence = result.evidence or Evidence()
    ticks = evidence.ticks
    records, timing = (None, None) if ticks is None else (ticks.records(), ticks.timing())
    if evidence.plan is not None:
        files["plan"] = save_png(plan_picture(evidence.plan), directory / "plan.png")
    storyboard = _storyboard(result)
    if storyboard is not None:
        files["storyboard"] = save_png(storyboard, directory / "storyboard.png")
    pictures = {name: files[name].read_bytes() for name in ("storyboard", "plan") if name in files}
    files["page"] = directory / "report.html"
    page = report_page(result.report, pictures.get("storyboard"), pictures.get("plan"), records, timing)
    files["page"].write_text(page, "utf-8")
    return files


def _storyboard(result: RunResult) -> Picture | None:
    """Return the storyboard of a run that has kept snapshots, None if there is nothing to draw."""
    evidence = result.evidence
    if evidence is None or evidence.storyboard is None:
        return None
    asked = judged(result.scenario.shape)
    inner = INNER_FRAMES if asked.passed_on else LIFT_INNER_FRAMES
    frames = pick_frames(evidence.storyboard.recorder.snapshots(), CLOSING_PHASES, inner)
    if not frames:
        return None
    title = f"{result.scenario.name}, seed {result.scenario.seed}: {result.failure or asked.achieved}"
    names = TASK_NAMES if asked.passed_on else asked.names
    return storyboard_picture(build_scene(result.scenario), frames, title=title, names=names)
