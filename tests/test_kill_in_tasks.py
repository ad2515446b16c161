"""Laws of the judgement of what a killed controller has left: who stopped in time, with what torque."""

from __future__ import annotations

import pytest

from preshape.hal.can.topology import TOPOLOGY
from preshape.hal.can.vocabulary import ModuleState
from preshape.sim_backend.joint_module import ModuleEvent
from preshape.sim_backend.modules_log import ModulesLog
from preshape.tools.kill_in_tasks import faults_of_modules, faults_of_served
from preshape.tools.modules_log_text import modules_log_lines

NODES = [module.node for module in TOPOLOGY.modules]


def printed(silence_ms: dict[int, int], torque: float = 0.9) -> str:
    """Return what a hand bus prints whose modules stopped by themselves after so long a silence."""
    events = [
        ModuleEvent(10**9 + ms * 10**6, node, ModuleState.FAULT, "watchdog", ms * 10**6)
        for node, ms in silence_ms.items()
    ]
    return "\n".join(modules_log_lines(ModulesLog(events, torque), TOPOLOGY))


def test_modules_that_all_stop_in_time_are_as_they_must_be() -> None:
    assert faults_of_modules(printed(dict.fromkeys(NODES, 21))) == []
    assert faults_of_modules(printed({node: 21 + node % 3 for node in NODES})) == []


def test_a_module_that_stops_late_or_not_at_all_is_told() -> None:
    late = dict.fromkeys(NODES, 21) | {NODES[3]: 31}
    assert any("later than 30 ms" in fault for fault in faults_of_modules(printed(late)))
    missing = dict.fromkeys(NODES[1:], 21)
    assert faults_of_modules(printed(missing)) == [f"{len(NODES) - 1} of {len(NODES)} modules stopped by themselves"]


@pytest.mark.parametrize("torque", [1.21, 3.0])
def test_torque_above_its_limit_is_told(torque: float) -> None:
    assert faults_of_modules(printed(dict.fromkeys(NODES, 21), torque)) == [f"torque {torque:.2f} of its limit"]


def test_served_joints_that_nobody_has_stopped_are_told_and_so_is_silence_about_torque() -> None:
    stopped = (
        "preshape serve: stopped: the client has gone\npreshape serve: largest torque in physics: 0.97 of its limit"
    )
    assert faults_of_served(stopped) == []
    assert faults_of_served("preshape serve: armed") == ["the joints were not stopped", "nothing is said of torque"]
