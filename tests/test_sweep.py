"""Sweeps: every run stands for itself, counts add up, and what is printed and written says so."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from sweep_runs import DIES, RAISES, WAITING_PLACE, fake_run, rough_run, run_outcome, threads_seen

from preshape.sim_backend.scenario import Scenario
from preshape.tools import command_sweep, sweep_run
from preshape.tools.command_sweep import Options, execute, sweep_cases
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.run_options import RunOptions
from preshape.tools.sweep import Backend, parse_seeds, sweep
from preshape.tools.sweep_run import THREAD_VARIABLES, RunCase
from preshape.tools.sweep_summary import causes_of, summarise
from preshape.tools.wilson import wilson


@pytest.fixture(autouse=True)
def threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put back after each test what sweeps set for the processes that they start."""
    for variable in THREAD_VARIABLES:
        monkeypatch.setenv(variable, "1")


def _case(seed: int, name: str = "one") -> RunCase:
    return RunCase(Scenario(name=name), seed, RunOptions())


@pytest.mark.parametrize("backend", ["loky", "threading"])
def test_outcomes_come_in_the_order_of_the_cases(backend: Backend) -> None:
    cases = [_case(seed, name) for name in ("one", "two") for seed in (4, 1, 2)]
    heard: list[tuple[str, str, int]] = []
    outcomes = sweep(cases, fake_run, backend, 2, lambda outcome: heard.append(outcome.key))
    assert [outcome.key for outcome in outcomes] == [case.key for case in cases]
    assert sorted(heard) == sorted(case.key for case in cases)
    assert [outcome.success for outcome in outcomes] == [True, False, True] * 2


def test_an_exception_and_a_dead_process_fail_their_own_run_only() -> None:
    outcomes = sweep([_case(seed) for seed in range(8)], rough_run, "loky", 2)
    by_seed = {outcome.seed: outcome for outcome in outcomes}
    assert by_seed[RAISES].cause is not None and by_seed[RAISES].cause.startswith("exception: RuntimeError: no such")
    assert by_seed[DIES].cause == "crashed: the process of this run died"
    assert all(by_seed[seed].failed_task is None for seed in (RAISES, DIES))
    for seed in set(by_seed) - {RAISES, DIES}:
        assert by_seed[seed].success == (seed % 2 == 0)


def test_a_killed_sweep_leaves_no_process_at_work(tmp_path: Path) -> None:
    code = (
        "import sweep_runs as r; from preshape.tools.sweep import sweep; from preshape.tools.sweep_run import RunCase;"
        "from preshape.tools.run_options import RunOptions; from preshape.sim_backend.scenario import Scenario;"
        "sweep([RunCase(Scenario(name='one'), seed, RunOptions()) for seed in range(4)], r.waiting_run, 'loky', 2)"
    )
    paths = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    environment = os.environ | {WAITING_PLACE: str(tmp_path), "PYTHONPATH": paths}
    parent = subprocess.Popen([sys.executable, "-c", code], env=environment)
    try:
        assert until(lambda: len(list(tmp_path.iterdir())) == 2, 60.0)
    finally:
        parent.kill()
        parent.wait()
    workers = [int(path.name) for path in tmp_path.iterdir()]
    assert until(lambda: not any(at_work(pid) for pid in workers), 10.0)


def until(condition: Callable[[], bool], seconds: float) -> bool:
    """Wait until a condition holds; return whether it did within the time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


def at_work(pid: int) -> bool:
    """Whether a process is there and has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def test_each_process_keeps_to_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in THREAD_VARIABLES:
        monkeypatch.delenv(variable, raising=False)
    (outcome,) = sweep([_case(0)], threads_seen, "loky", 2)
    assert outcome.cause == ",".join("1" for _ in THREAD_VARIABLES)


@pytest.mark.parametrize("backend", ["dask", "ray"])
def test_a_back_end_that_is_not_installed_is_named(backend: Backend, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("ray", "distributed"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ConfigurationError, match=f"backend: {backend} needs the package"):
        sweep([_case(0)], fake_run, backend, 1)


@pytest.mark.parametrize(
    ("text", "seeds"), [("7", (7,)), ("0:4", (0, 1, 2, 3)), ("2:9:3", (2, 5, 8)), ("1,5,8:10", (1, 5, 8, 9))]
)
def test_seeds_are_read_in_every_form(text: str, seeds: tuple[int, ...]) -> None:
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "1:", "5:5", "-1", "1,1", "0:3,2", "1:2:3:4", "0:9:0"])
def test_seeds_that_name_nothing_or_one_twice_are_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match="seeds: got"):
        parse_seeds(text)


def test_counts_add_up_and_carry_their_interval() -> None:
    outcomes = [
        run_outcome(0),
        run_outcome(1, 4, "slipped: a"),
        run_outcome(2, 2, "unseen: b"),
        run_outcome(3, 4, "slipped: c"),
    ]
    (summary,) = summarise(outcomes)
    assert (summary.success.count, summary.success.of) == (1, 4)
    assert summary.success.interval == wilson(1, 4)
    assert [share.count for share in summary.tasks] == [4, 3, 3, 1, 1]
    assert summary.mean_simulated_s == pytest.approx(11.5)


def test_every_failure_is_in_exactly_one_cause_and_frequent_ones_come_first() -> None:
    outcomes = [
        run_outcome(0),
        run_outcome(1, 2, "unseen: b"),
        run_outcome(2, 4, "slipped: a"),
        run_outcome(3, 4, "slipped: c"),
        run_outcome(4, None, "exception: x"),
        run_outcome(5, 3, "slipped: d"),
    ]
    causes = causes_of(outcomes)
    assert [(cause.task, cause.cause, cause.seeds) for cause in causes] == [
        (4, "slipped", (2, 3)),
        (None, "exception", (4,)),
        (2, "unseen", (1,)),
        (3, "slipped", (5,)),
    ]
    assert causes[0].example == "task 4: slipped: a"


def test_figures_are_over_the_runs_that_reported_them() -> None:
    (summary,) = summarise([run_outcome(0, slip_mm=1.0), run_outcome(1, slip_mm=4.0), run_outcome(2, 1, "crashed: x")])
    slip = next(spread for spread in summary.figures if spread.name == "hold_slip_mm")
    assert (slip.least, slip.median, slip.most) == (1.0, 2.5, 4.0)
    (silent,) = summarise([run_outcome(0, 1, "crashed: x")])
    assert silent.figures == ()


def test_scenarios_are_counted_apart() -> None:
    outcomes = [run_outcome(0, name="b"), run_outcome(0, name="a"), run_outcome(1, 1, "x", name="b")]
    assert [(summary.scenario, str(summary.success.count)) for summary in summarise(outcomes)] == [
        ("b", "1"),
        ("a", "1"),
    ]


def test_a_case_for_every_scenario_and_seed_with_the_options_of_the_runs() -> None:
    options = Options(
        scenario=("tea_box", "tea_box_lying"), seeds="0:3", ties="hard", norm="l1", overrides=("strengths.scale=2.0",)
    )
    cases = sweep_cases(options)
    assert [case.key for case in cases] == [
        (name, "", seed) for name in ("tea_box", "tea_box_lying") for seed in range(3)
    ]
    assert all(case.options == RunOptions(ties="hard", norm="l1", record=False, pictures=False) for case in cases)
    assert all(case.scenario.strengths.scale == 2.0 for case in cases)


def test_one_scenario_twice_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="different names"):
        sweep_cases(Options(scenario=("tea_box", "tea_box")))


def test_a_file_that_cannot_be_written_is_refused_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep_run, "run_case", lambda case: pytest.fail("something ran"))
    (tmp_path / "file").write_text("kept")
    for place in (tmp_path, tmp_path / "file" / "sweep.json"):
        with pytest.raises(ConfigurationError, match=f"--json {place}: cannot be written"):
            execute(Options(seeds="0:4", backend="threading", jobs=1, json=place))
    assert (tmp_path / "file").read_text() == "kept" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(("at_least", "code"), [(2, 0), (3, 1)])
def test_prints_and_writes_the_same_counts_and_judges_them(
    at_least: int, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sweep_run, "run_case", fake_run)
    file = tmp_path / "out" / "sweep.json"
    options = Options(seeds="0:4", backend="threading", jobs=1, json=file, at_least=at_least)
    assert execute(options) == code
    captured = capsys.readouterr()
    assert "2 of 4 = 50 %" in captured.out and "slipped" in captured.out
    assert "tea_box seed 3: task 4: slipped: the left hand" in captured.out
    assert "[4/4]" in captured.err
    written = json.loads(file.read_text())
    assert written["schema"] == command_sweep.SCHEMA
    assert written["summaries"][0]["success"]["count"] == 2
    assert [outcome["seed"] for outcome in written["outcomes"]] == [0, 1, 2, 3]
    assert [path.name for path in file.parent.iterdir()] == ["sweep.json"]
