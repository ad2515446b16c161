"""Laws of whole runs in physics: the report of one, the same commands from the same seed, and one in real time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from preshape.tools.configuration import load_scenario
from preshape.tools.report import decode_report, encode_report
from preshape.tools.run_options import RunOptions
from preshape.tools.session import run_session

pytestmark = pytest.mark.physics

QUIET = RunOptions(record=False, pictures=False)


def test_a_whole_run_ends_by_itself_and_its_report_holds_together() -> None:
    result = run_session(load_scenario("tea_box"), 0, QUIET)
    report = result.report
    assert decode_report(encode_report(report)) == report
    assert report.success == (report.failure is None) == (not report.referee.failures)
    assert result.exit_code == (0 if report.success else 1)
    assert report.loop.outcome == "finished"
    assert 0.0 < report.sim.seconds < QUIET.time_limit_s
    assert report.tasks[0].outcome == "done" and report.referee.tasks[0].done
    started = [task for task in report.tasks if task.attempts]
    assert all(task.start_s <= task.end_s <= report.sim.seconds for task in started)
    assert [task.start_s for task in started] == sorted(task.start_s for task in started)
    assert report.loop.refused == 0 and report.observer_failures == []


def test_the_same_seed_gives_the_same_commands_and_another_seed_others() -> None:
    options = RunOptions(record=False, pictures=False, time_limit_s=6.0)
    scenario = load_scenario("tea_box")
    first, again, other = (run_session(scenario, seed, options).report.commands_sha256 for seed in (0, 0, 1))
    assert first == again
    assert first != other


def test_a_paced_run_reports_its_lateness_beside_an_empty_loops() -> None:
    report = run_session(load_scenario("tea_box"), 0, RunOptions(paced=True, time_limit_s=2.0)).report
    assert report.paced
    assert report.loop.empty_lateness_us is not None
    assert report.loop.outcome in ("time up", "safety stop")
    assert report.sim.seconds > 0.0
    assert decode_report(encode_report(report)) == report


@pytest.mark.parametrize(
    ("number", "end", "reason"),
    [(signal.SIGINT, os.killpg, "interrupted from the keyboard"), (signal.SIGTERM, os.kill, "asked to terminate")],
)
def test_ctrl_c_and_sigterm_stop_a_paced_run_with_all_its_processes_and_leave_a_report(
    tmp_path: Path, number: int, end: Callable[[int, int], None], reason: str
) -> None:
    # 100 Hz: what is tested is the stop, on a machine that other tests keep busy.
    arguments = ["run", "--paced", "--rate-hz", "100", "--time-limit-s", "60", "--no-pictures", "--out", str(tmp_path)]
    program = f"from preshape.tools.cli import main; main({arguments!r})"
    # A session of its own, as a terminal makes one: the interrupt reaches every process in it.
    with subprocess.Popen(
        [sys.executable, "-u", "-c", program], stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as run:
        assert run.stdout is not None
        try:
            assert "task 1 grasp" in run.stdout.readline()
            end(run.pid, number)
            printed, _ = run.communicate(timeout=60)
        finally:
            if run.poll() is None:
                os.killpg(run.pid, signal.SIGKILL)
    assert run.returncode == 4, printed
    report = decode_report((tmp_path / "report.json").read_bytes())
    assert report.loop.outcome == "stopped"
    assert reason in report.loop.reason


def test_a_run_until_the_grasp_ends_with_it_and_says_so() -> None:
    report = run_session(load_scenario("tea_box"), 0, RunOptions(until_task=1, record=False, pictures=False)).report
    assert report.success and report.referee.until_task == 1
    assert report.done == "task 1 is done"
    assert [task.outcome for task in report.tasks] == ["done", *["not asked"] * 4]
    assert report.sim.seconds < 30.0
