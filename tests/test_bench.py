"""Benchmarks: stages are booked exactly once, bars judge, and a real tick is measured stage by stage."""

import json
from collections.abc import Callable

import pytest

from preshape.tools.area_figures import area_figures
from preshape.tools.bench_table import BENCHES, Bar, Bench, unit_of
from preshape.tools.bench_tick import STAGES, bench_tick
from preshape.tools.command_bench import Options, as_json, execute, missed
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.stage_times import StageTimes, watching


class _Clock:
    """A clock that only work advances."""

    def __init__(self) -> None:
        self.ns = 0

    def __call__(self) -> int:
        return self.ns


class _Worker:
    def __init__(self, clock: _Clock) -> None:
        self.clock = clock

    def outer(self, us: int) -> str:
        self.clock.ns += us * 1000
        self.inner(us * 10)
        return "done"

    def inner(self, us: int) -> None:
        self.clock.ns += us * 1000

    def fails(self) -> None:
        self.clock.ns += 5000
        raise KeyError("as it should")


METHODS = {(_Worker, "outer"): "outer", (_Worker, "inner"): "inner", (_Worker, "fails"): "outer"}


@pytest.fixture
def clock() -> _Clock:
    return _Clock()


def test_a_stage_inside_another_is_booked_once(clock: _Clock) -> None:
    times, worker = StageTimes(("outer", "inner"), clock), _Worker(clock)
    with watching(times, METHODS):
        assert worker.outer(3) == "done"
        worker.inner(1)
        times.end_tick(keep=True)
        worker.outer(2)
        times.end_tick(keep=True)
    assert times.table_us().tolist() == [[3.0, 31.0], [2.0, 20.0]]


def test_forgotten_ticks_leave_nothing_behind(clock: _Clock) -> None:
    times, worker = StageTimes(("outer", "inner"), clock), _Worker(clock)
    with watching(times, METHODS):
        worker.outer(7)
        times.end_tick(keep=False)
        worker.inner(1)
        times.end_tick(keep=True)
    assert times.table_us().tolist() == [[0.0, 1.0]]


def test_a_call_that_raises_is_booked_and_the_classes_are_restored(clock: _Clock) -> None:
    times, worker, before = StageTimes(("outer", "inner"), clock), _Worker(clock), dict(vars(_Worker))
    with pytest.raises(KeyError), watching(times, METHODS):
        worker.fails()
    assert dict(vars(_Worker)) == before
    times.end_tick(keep=True)
    assert times.table_us().tolist() == [[5.0, 0.0]]


@pytest.mark.parametrize(("figure", "least", "most"), [(1.0, True, True), (2.0, True, False), (0.5, False, True)])
def test_a_bar_is_met_on_its_side_and_on_the_line(figure: float, least: bool, most: bool) -> None:
    assert (Bar(">=", 1.0).met(figure), Bar("<=", 1.0).met(figure)) == (least, most)


def test_no_bar_is_met_by_what_is_not_a_number() -> None:
    assert not Bar(">=", 1.0).met(float("nan")) and not Bar("<=", 1.0).met(float("nan"))


def _with(monkeypatch: pytest.MonkeyPatch, figures: Callable[[], dict[str, float]]) -> None:
    import preshape.tools.bench_distances as module

    monkeypatch.setattr(module, "bench_distances", figures)


@pytest.mark.parametrize(("ratio", "code"), [(1500.0, 0), (900.0, 1)])
def test_the_exit_code_says_whether_all_bars_were_met(
    ratio: float, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _with(monkeypatch, lambda: {"l1_us_per_pair": 0.5, "scipy_lp_over_l1": ratio})
    assert execute(Options(names=("distances",), json=True)) == code
    printed = json.loads(capsys.readouterr().out)["distances"]
    assert printed["figures"]["scipy_lp_over_l1"] == ratio
    assert printed["missed"] == (["scipy_lp_over_l1"] if code else [])


def test_the_table_shows_figures_units_and_bars(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _with(monkeypatch, lambda: {"l1_us_per_pair": 0.5, "scipy_lp_over_l1": 12.0})
    execute(Options(names=("distances",)))
    printed = capsys.readouterr().out
    assert "us a pair" in printed and ">= 1000: missed" in printed


def test_areas_are_reported_as_plain_figures() -> None:
    figures = area_figures(3)
    assert figures["cases"] == 3 and figures["differences"] == 0
    assert figures["areas_committed_median_us"] > 0
    assert set(BENCHES["areas"].bars) <= set(figures)


def test_an_unknown_benchmark_is_refused_by_name() -> None:
    with pytest.raises(ConfigurationError, match=r"'nothing'.*tick"):
        execute(Options(names=("nothing",)))


def test_a_figure_that_was_not_measured_misses_nothing() -> None:
    bench = Bench("module", "function", "summary", {"absent": Bar(">=", 1.0)})
    assert missed(bench, {"other": 0.0}) == []


@pytest.mark.parametrize("name", BENCHES)
def test_every_benchmark_of_the_table_exists(name: str) -> None:
    import importlib

    assert callable(getattr(importlib.import_module(BENCHES[name].module), BENCHES[name].function))


@pytest.mark.parametrize(
    ("name", "unit"), [("tick_us", "us"), ("l1_us_per_pair", "us a pair"), ("solved_share", "of 1"), ("pairs", "")]
)
def test_units_are_read_from_names(name: str, unit: str) -> None:
    assert unit_of(name) == unit


def test_json_carries_bars_beside_figures() -> None:
    assert json.loads(as_json({"tick": {"tick_us": 901.0}}))["tick"] == {
        "figures": {"tick_us": 901.0},
        "bars": {"tick_us": "<= 900", "telemetry_us": "<= 15", "scipy_lp_over_l1": ">= 1000"},
        "missed": ["tick_us"],
    }


@pytest.mark.physics
def test_every_stage_of_a_real_tick_is_measured() -> None:
    figures = bench_tick(ticks=20)
    assert figures["ticks"] == 20
    stages = [figures[f"{stage.replace(' ', '_')}_us"] for stage in STAGES]
    assert min(stages) > 0.0
    # Every stage is inside the tick, and they are booked once.
    assert sum(stages) < 2.0 * figures["tick_us"]
