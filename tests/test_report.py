"""Laws of the report: the contract's keys, what counts as the cause, a page that says it first and stands alone."""

from __future__ import annotations

import os
import re
import signal
from dataclasses import fields, replace
from html import unescape

import msgspec
import numpy as np
import pytest

from preshape.control.loop_result import LoopOutcome, LoopResult
from preshape.control.timing import LoopTiming
from preshape.hal.device import DeviceUnreachable
from preshape.hal.tick_record import TickRecord
from preshape.sim_backend.referee_report import TASK_NAMES, TaskTruth, Verdict
from preshape.tools.configuration import load_scenario
from preshape.tools.exit_codes import ExitCode
from preshape.tools.report import RefereeReport, Report, decode_report, encode_report, referee_report
from preshape.tools.report_html import report_page
from preshape.tools.run_ended import Ended
from preshape.tools.run_failure import name_failure
from preshape.tools.run_options import RunOptions
from preshape.tools.run_result import RunResult
from preshape.tools.run_world import LockstepRun
from preshape.tools.series import Series
from preshape.tools.session import run_session
from preshape.tools.stop_signals import StopSignals
from preshape.tools.svg_plot import Plot, envelope, svg

CONTRACT: dict[str, tuple[str, ...]] = {
    "": (
        "schema", "version", "device", "seed", "scenario", "success", "failure", "tasks", "plan", "commands_sha256",
        "referee", "loop", "sim",
    ),
    "tasks.0": ("task", "name", "outcome", "start_s", "end_s", "attempts"),
    "plan": ("time_ms", "priorities", "components"),
    "plan.priorities": ("r", "l", "c"),
    "referee": (
        "undesired_contacts", "desired_contacts_made", "dropped", "crushed", "max_torque_ratio", "hold_slip_mm",
        "regrasp_motion_mm", "tab_angle_deg", "lid_angle_deg", "torn_fraction",
    ),
    "loop": ("rate_hz", "ticks", "overruns", "compute_us", "lateness_us"),
    "loop.compute_us": ("p50", "p99", "p99_9", "max"),
    "loop.lateness_us": ("p50", "p99", "p99_9", "max"),
    "sim": ("seconds", "realtime_factor"),
}  # fmt: skip
"""Object -> the keys that schema preshape/report/1 promises."""

SHORT = RunOptions(time_limit_s=0.1)

VERDICT = Verdict(
    undesired_contacts=(),
    self_contacts=(),
    desired_contacts_made={"1": True},
    dropped=False,
    crushed=False,
    max_torque_ratio=0.5,
    max_torque_joint="right_thumb_flex",
    peak_torque_ratio=0.6,
    max_commanded_ratio=1.0,
    hold_slip_mm=1.0,
    worst_link_slip_mm=1.0,
    regrasp_motion_mm=1.0,
    max_panel_load_n={"+x": 3.0},
    tab_angle_deg=40.0,
    max_tab_angle_deg=50.0,
    lid_angle_deg=90.0,
    max_lid_angle_deg=95.0,
    tab_torn=True,
    torn_fraction=1.0,
    opening_error=(0.001, 0.02),
    tasks=tuple(TaskTruth(k, TASK_NAMES[k], True, float(k - 1), float(k)) for k in TASK_NAMES),
    events={},
)
"""A success."""


@pytest.fixture(scope="module")
def result() -> RunResult:
    return run_session(load_scenario("tea_box"), 0, SHORT)


def ended(outcome: LoopOutcome, reason: str) -> LoopResult:
    return LoopResult(outcome, reason, 1, 1, 0, "", LoopTiming(1).report())


def test_the_report_has_every_key_of_the_contract(result: RunResult) -> None:
    data = msgspec.json.decode(encode_report(result.report))
    for path, keys in CONTRACT.items():
        here = data
        for step in path.split(".") if path else ():
            here = here[int(step)] if step.isdecimal() else here[step]
        assert set(keys) <= set(here), path
    assert data["schema"] == "preshape/report/1"
    assert [task["task"] for task in data["tasks"]] == [1, 2, 3, 4, 5]
    assert data["plan"]["priorities"] == {
        "r": [2, 2, 2, 1, 1],
        "l": [None, None, 3, 3, 3],
        "c": [None, 1, None, None, None],
    }
    assert data["scenario"]["box"]["friction"] == load_scenario("tea_box").drawn(0).box.friction


def test_a_report_survives_its_file_and_no_other_schema_is_taken(result: RunResult) -> None:
    data = encode_report(result.report)
    assert decode_report(data) == result.report
    with pytest.raises(msgspec.ValidationError, match="schema"):
        decode_report(data.replace(b"preshape/report/1", b"preshape/report/2"))
    with pytest.raises(msgspec.ValidationError, match="unknown field"):
        decode_report(data.replace(b'"crushed"', b'"squashed"'))


def test_the_referees_part_leaves_out_nothing_of_the_verdict() -> None:
    names = {field.name for field in fields(Verdict)} | {"success", "failures"}
    assert {field.name for field in msgspec.structs.fields(RefereeReport)} == names
    assert referee_report(VERDICT).success


def test_a_run_always_ends_at_its_time_limit_and_says_so(result: RunResult) -> None:
    report = result.report
    assert result.exit_code == ExitCode.TASK_FAILED
    assert not report.success
    assert report.loop.outcome == "time up"
    assert report.loop.reason.startswith(f"{round(SHORT.time_limit_s * report.loop.rate_hz)} ticks")
    assert report.failed_task == 1
    assert report.cause is not None and report.cause.startswith("timed out")
    assert report.sim.seconds == pytest.approx(SHORT.time_limit_s, abs=0.05)
    assert len(report.commands_sha256) == 64


def test_the_commands_depend_on_scenario_seed_and_options_alone(result: RunResult) -> None:
    again = run_session(load_scenario("tea_box"), 0, RunOptions(time_limit_s=0.1, record=False, pictures=False))
    assert again.report.commands_sha256 == result.report.commands_sha256
    assert again.evidence is None


def test_an_impossible_task_is_a_failure_in_which_nothing_moves() -> None:
    scenario = load_scenario("tea_box", ("box.position_m=[0.9, 0.5]", "draw.position_m=0.0"))
    result = run_session(scenario, 0, RunOptions(paced=True))
    assert result.exit_code == ExitCode.TASK_FAILED
    assert result.report.cause is not None and result.report.cause.startswith("unreachable: the right hand")
    assert result.report.loop.ticks == 0 and result.report.loop.outcome == "not run"
    assert result.report.sim.seconds == 0.0
    assert decode_report(encode_report(result.report)) == result.report


class Interrupting:
    """An observer that presses Ctrl-C once."""

    def __init__(self, tick: int) -> None:
        self._tick = tick

    def notify(self, record: TickRecord) -> None:
        if int(record["tick"]) == self._tick:
            os.kill(os.getpid(), signal.SIGINT)


def test_an_interrupt_brakes_and_is_reported_as_a_stop() -> None:
    before = signal.getsignal(signal.SIGINT)
    options = RunOptions(time_limit_s=2.0, record=False, pictures=False)
    with StopSignals() as signals:
        result = run_session(load_scenario("tea_box"), 0, options, [Interrupting(20)], signals=signals)
    assert result.exit_code == ExitCode.SAFETY_STOP
    assert result.report.loop.outcome == "stopped"
    assert result.report.cause is not None and "interrupted from the keyboard" in result.report.cause
    assert signal.getsignal(signal.SIGINT) is before


def test_a_world_that_is_lost_leaves_a_report_that_says_how(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(self: LockstepRun) -> Ended:
        raise DeviceUnreachable("preshape/box/device: its server has gone")

    monkeypatch.setattr(LockstepRun, "finish", lost)
    lost_run = run_session(load_scenario("tea_box"), 0, SHORT)
    report = lost_run.report
    assert lost_run.exit_code == ExitCode.UNREACHABLE and not report.success and report.referee is None
    assert report.failure is not None
    assert report.failure.startswith("task 1 (grasp): world lost: preshape/box/device: its server has gone; in ")
    assert "timed out: " in report.failure and report.tasks[0].outcome == "interrupted"
    assert [task.name for task in report.tasks] == list(TASK_NAMES.values())
    assert report.sim.seconds == pytest.approx(SHORT.time_limit_s, abs=0.05)
    assert decode_report(encode_report(report)) == report
    assert "nothing that happened in it is judged" in report_page(report)


class Broken:
    """An observer that raises."""

    def notify(self, record: TickRecord) -> None:
        raise ArithmeticError("no more")


def test_an_observer_that_gives_up_is_reported_and_changes_nothing(result: RunResult) -> None:
    other = run_session(load_scenario("tea_box"), 0, SHORT, [Broken()])
    assert other.report.observer_failures == ["Broken: ArithmeticError: no more"]
    assert other.report.commands_sha256 == result.report.commands_sha256


def test_the_cause_is_the_errors_then_the_loops_then_the_controllers_then_the_referees() -> None:
    undone = (*VERDICT.tasks[:3], *(replace(task, done=False, end_s=None) for task in VERDICT.tasks[3:]))
    bad = replace(VERDICT, tasks=undone, dropped=True, events={"dropped": 3.5})
    done, stop = ended(LoopOutcome.FINISHED, "done"), ended(LoopOutcome.SAFETY_STOP, "watchdog")
    said = "task 4 (crush): stalled: no way on: still 20 mm"
    assert name_failure(VERDICT, done, 5, None, None) is None
    assert name_failure(VERDICT, stop, 5, said, "error: after the end") is None
    assert str(name_failure(bad, None, 2, said, "error: x")) == "task 2 (inspect): error: x"
    failure = name_failure(bad, stop, 4, said, None)
    assert failure is not None and failure.cause == "safety stop: watchdog"
    failure = name_failure(bad, done, 4, said, None)
    assert failure is not None and failure.cause == "stalled: no way on: still 20 mm"
    assert failure.also == ("dropped",), "and not what a failed task leaves undone anyway"
    failure = name_failure(bad, done, 5, None, None)
    assert failure is not None and (failure.task, failure.cause) == (4, "dropped: at 3.50 s")


def test_the_earliest_thing_against_a_run_is_its_cause() -> None:
    done = ended(LoopOutcome.FINISHED, "done")
    verdict = replace(
        VERDICT,
        undesired_contacts=(("right_palm", "table", 2.5), ("left_palm", "table", 3.0)),
        crushed=True,
        events={"crushed": 4.2},
    )
    failure = name_failure(verdict, done, 5, None, None)
    assert failure is not None
    assert (failure.task, failure.cause) == (3, "undesired contact: right_palm on table at 2.50 s")
    assert failure.also == ("crushed",)
    slipped = name_failure(replace(VERDICT, hold_slip_mm=7.0), done, 5, None, None)
    assert slipped is not None and slipped.cause == "slip above 5 mm" and slipped.also == ()


def test_a_run_until_a_task_is_judged_on_the_tasks_up_to_it() -> None:
    undone = (*VERDICT.tasks[:3], *(replace(task, done=False, end_s=None) for task in VERDICT.tasks[3:]))
    whole = replace(VERDICT, tasks=undone, torn_fraction=0.0)
    assert whole.failures == ("task 4 (crush) not done", "task 5 (open) not done", "torn fraction below 0.9")
    for last in (1, 2, 3):
        assert replace(whole, until_task=last).success
    assert replace(whole, until_task=4).failures == ("task 4 (crush) not done",)
    dropped = replace(whole, until_task=3, dropped=True, events={"dropped": 3.5})
    failure = name_failure(dropped, ended(LoopOutcome.FINISHED, "done"), 3, None, None)
    assert failure is not None and failure.cause == "dropped: at 3.50 s"
    assert failure.also == (), "and not what was not asked for"


def test_the_page_names_the_cause_before_anything_else_and_needs_no_other_file(result: RunResult) -> None:
    assert result.evidence is not None and result.evidence.ticks is not None
    ticks = result.evidence.ticks
    page = report_page(result.report, b"\x89PNG", None, ticks.records(), ticks.timing())
    assert result.report.failure is not None
    assert unescape(page.split("<h2>")[0]).count(result.report.failure) == 1
    assert set(re.findall(r'(?:src|href)="([^"]{5})', page)) == {"data:"}
    assert "<script" not in page and "http" not in page
    # Torques of both sides and the loop's times; no distance was measured in so short a run.
    assert page.count("<svg") == page.count("</svg>") == 3


def test_texts_cannot_break_the_page(result: RunResult) -> None:
    nasty = '<b>&"'
    report: Report = msgspec.structs.replace(result.report, failure=nasty, notes=[nasty])
    assert "<b>" not in report_page(report)


def test_an_envelope_loses_no_peak_and_keeps_gaps() -> None:
    rng = np.random.default_rng(4)
    values = rng.standard_normal(10_000)
    values[3000:3400] = np.nan
    time_s, kept = envelope(np.arange(10_000.0), values, 100)
    assert len(kept) <= 200
    assert np.nanmax(kept) == np.nanmax(values) and np.nanmin(kept) == np.nanmin(values)
    assert np.all(np.diff(time_s) > 0)
    assert np.isnan(kept).any()


def test_plots_of_nothing_and_of_constants_are_drawn() -> None:
    for count, value in ((0, 0.0), (1, 3.0), (5, np.nan), (5, 0.0), (5, -2.0)):
        series = Series("a/b", ("one", "two"), np.full((count, 2), value))
        for logarithmic in (False, True):
            text = svg(Plot("a < b", "N", np.arange(float(count)), series, None, (), logarithmic))
            assert "nan" not in text and "inf" not in text
            assert "a &lt; b" in text
