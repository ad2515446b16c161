"""Sweeps over faults: every campaign with every seed, counted fault by fault."""

from __future__ import annotations

import io

import msgspec
import pytest
from rich.console import Console
from sweep_runs import fake_run, figures, run_outcome

from preshape.sim_backend.scenario import Scenario
from preshape.tools.command_sweep import Options, sweep_cases
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.fault_matrix import OPENED, fault_rows, matrix
from preshape.tools.run_options import RunOptions
from preshape.tools.sweep import sweep
from preshape.tools.sweep_run import RunCase, RunOutcome, WireFigures
from preshape.tools.sweep_summary import summarise


def _outcome(seed: int, faults: str, cause: str | None, broken: dict[str, int] | None = None) -> RunOutcome:
    wire = WireFigures(broken=broken or {}, torque_limit_ratio=1.0, torque_ratio=0.5 + 0.1 * seed)
    return msgspec.structs.replace(
        run_outcome(seed, None if cause is None else 2, cause), faults=faults, wire=wire, figures=figures(1.0)
    )


OUTCOMES = [
    _outcome(0, "", None),
    _outcome(1, "", None),
    _outcome(0, "loss5", None),
    _outcome(1, "loss5", "safety stop: a module is lost"),
    _outcome(2, "loss5", "safety stop: another is lost"),
    _outcome(0, "bad_wire", "exception: ValueError"),
    _outcome(1, "bad_wire", "timed out: 10 s", {"speed": 3}),
]


def test_a_row_counts_what_became_of_its_runs() -> None:
    clean, loss, bad = fault_rows(OUTCOMES)
    assert (clean.label, loss.label, bad.label) == ("one", "one with loss5", "one with bad_wire")
    assert dict(clean.outcomes) == {OPENED: 2}
    assert dict(loss.outcomes) == {OPENED: 1, "safety stop": 2}
    assert (loss.torque_ratio, loss.torque_limit_ratio, loss.physics_ratio) == (0.7, 1.0, 0.9)
    assert clean.sound and loss.sound and not bad.sound
    assert (bad.unnamed, dict(bad.broken)) == (1, {"speed": 3})


def test_the_matrix_shows_every_fault_and_every_outcome() -> None:
    console = Console(width=160, file=io.StringIO(), record=True)
    console.print(matrix(fault_rows(OUTCOMES)))
    text = console.export_text()
    for word in ("loss5", "bad_wire", OPENED, "safety stop", "timed out", "exception", "speed 3", "none"):
        assert word in text


def test_faults_are_counted_apart_from_runs_without_them() -> None:
    assert [(summary.scenario, summary.success.of) for summary in summarise(OUTCOMES)] == [
        ("one", 2),
        ("one with loss5", 3),
        ("one with bad_wire", 2),
    ]


def test_runs_of_different_faults_with_one_seed_are_kept_apart() -> None:
    options = [RunOptions(device="can", faults=faults) for faults in ("", "loss1", "loss5")]
    cases = [RunCase(Scenario(name="one"), seed, how) for how in options for seed in range(3)]
    outcomes = sweep(
        cases, lambda case: msgspec.structs.replace(fake_run(case), faults=case.options.faults), "threading", 1
    )
    assert [outcome.key for outcome in outcomes] == [case.key for case in cases]
    assert len(outcomes) == 9


def test_every_campaign_is_run_with_every_seed() -> None:
    cases = sweep_cases(Options(device="can", seeds="0:2", campaigns=("none", "loss1", "drop=0.5,jitter_ms=1")))
    assert [(case.options.faults, case.seed) for case in cases] == [
        (faults, seed) for faults in ("", "loss1", "drop=0.5,jitter_ms=1") for seed in range(2)
    ]


@pytest.mark.parametrize(
    ("campaigns", "words"),
    [
        (("loss1", "dorp=1"), "--faults: got 'dorp=1', allowed is a campaign"),
        (("loss1", "loss1"), "--faults: got loss1 loss1, allowed are different ones"),
    ],
)
def test_campaigns_are_checked_before_anything_runs(campaigns: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        sweep_cases(Options(device="can", campaigns=campaigns))


def test_faults_need_a_bus() -> None:
    with pytest.raises(ConfigurationError, match="--faults: got loss1 with --device mujoco"):
        RunOptions(faults="loss1")
    with pytest.raises(ConfigurationError, match="--faults: got loss1 with --device mujoco"):
        sweep_cases(Options(campaigns=("none", "loss1")))
