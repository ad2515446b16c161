"""Faults as they are written on the command line."""

from __future__ import annotations

import math

import pytest

from preshape.hal.can.topology import TOPOLOGY
from preshape.sim_backend.fault_plan import FaultEvent, FaultKind, FaultPlan, FrameFaults
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.fault_text import CAMPAIGNS, parse_faults


def test_nothing_goes_wrong_by_default() -> None:
    assert parse_faults("") == parse_faults("none") == FaultPlan()
    assert not parse_faults("").any


def test_chances_and_times_are_taken_in_si_units() -> None:
    plan = parse_faults("drop=0.01, duplicate=0.02,reorder=0.03,corrupt=0.04,delay_ms=1.5,jitter_ms=2")
    wanted = FrameFaults(drop=0.01, duplicate=0.02, reorder=0.03, corrupt=0.04, delay_s=1.5e-3, jitter_s=2e-3)
    assert plan == FaultPlan(frames=wanted)
    assert plan.any


@pytest.mark.parametrize(
    ("text", "event"),
    [
        ("node_death=right_fore@task3+0.5",
         FaultEvent(kind=FaultKind.NODE_DEATH, target="right_fore", task=3, after_s=0.5)),
        ("node_reboot=left_thumb@12.5/0.2",
         FaultEvent(kind=FaultKind.NODE_DEATH, target="left_thumb", after_s=12.5, lasts_s=0.2)),
        ("bus_off=arms@task1", FaultEvent(kind=FaultKind.BUS_OFF, target="arms", task=1)),
        ("torque_freeze=right_ring@task2/3",
         FaultEvent(kind=FaultKind.TORQUE_FREEZE, target="right_ring", task=2, lasts_s=3.0)),
        ("torque_drift=right_ring:-0.05@task2",
         FaultEvent(kind=FaultKind.TORQUE_DRIFT, target="right_ring", task=2, rate=-0.05)),
        ("host_stall_ms=30@task5+1", FaultEvent(kind=FaultKind.HOST_STALL, task=5, after_s=1.0, lasts_s=0.03)),
    ],
)  # fmt: skip
def test_events_name_what_where_and_when(text: str, event: FaultEvent) -> None:
    assert parse_faults(f"drop=0.5,{text}") == FaultPlan(frames=FrameFaults(drop=0.5), events=(event,))
    assert math.isinf(event.lasts_s) == ("/" not in text and event.kind is not FaultKind.HOST_STALL)


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_every_named_campaign_is_a_plan(name: str) -> None:
    assert parse_faults(name).any == (name != "none")


def test_campaigns_cover_every_kind_of_fault_and_every_task() -> None:
    plans = [parse_faults(name) for name in CAMPAIGNS]
    assert {event.kind for plan in plans for event in plan.events} == set(FaultKind)
    for kind in (FaultKind.NODE_DEATH, FaultKind.BUS_OFF):
        assert {event.task for plan in plans for event in plan.events if event.kind is kind} == {1, 2, 3, 4, 5}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("loss", "--faults: got 'loss', allowed is a campaign (none, loss1, "),
        ("dorp=0.1", "--faults: got 'dorp=0.1', allowed is"),
        ("drop=much", "--faults: drop: got 'much', allowed is a number"),
        ("drop=nan", "--faults: drop: got 'nan', allowed is a finite number"),
        ("drop=1.1", "--faults: drop: got 1.1, allowed is 0 .. 1"),
        ("drop=0.1,drop=0.2", "--faults: got drop twice, allowed is once"),
        ("jitter_ms=-1", "--faults: jitter_s: got -0.001, allowed is 0 .. 1"),
        ("node_death=right_fore", "--faults: node_death: got 'right_fore', allowed is NAME@WHEN"),
        ("node_death=right_fore@task6", "--faults: node_death: got 'right_fore@task6', allowed is NAME@WHEN"),
        ("node_death=nose@task1", "--faults: node_death: got 'nose', allowed are right_thumb, "),
        ("node_death=right_fore@1.2.3", "--faults: node_death: got '1.2.3', allowed is a number"),
        ("node_reboot=right_fore@task1", "--faults: node_reboot: got 'right_fore@task1', allowed is NAME@WHEN/SECONDS"),
        ("node_reboot=right_fore@task1/0", "--faults: node_death: got 0 s long, allowed is > 0"),
        ("bus_off=right_fore@task1", "--faults: bus_off: got 'right_fore', allowed are right_hand, left_hand, arms"),
        ("torque_drift=right_fore@task1", "--faults: torque_drift of right_fore, N m/s: got '', allowed is a number"),
        ("torque_drift=right_fore:0@task1", "--faults: torque_drift: got 0 N m/s, allowed is not 0"),
        ("host_stall_ms=long@task1", "--faults: host_stall_ms: got 'long', allowed is a number"),
        ("host_stall_ms=0@task1", "--faults: host_stall: got 0 s long, allowed is > 0"),
        ("host_stall_ms=30@task1/2", "--faults: host_stall_ms: got '30@task1/2', allowed is MILLISECONDS@WHEN"),
    ],
)
def test_what_is_not_known_or_not_allowed_is_named(text: str, words: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse_faults(text)
    assert str(caught.value).startswith(words)


def test_names_come_from_the_topology_in_use() -> None:
    for module in TOPOLOGY.modules:
        assert parse_faults(f"node_death={module.name}@1").events[0].target == module.name
