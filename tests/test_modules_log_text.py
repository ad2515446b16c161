"""Laws of the modules' log as text."""

from __future__ import annotations

from preshape.hal.can.topology import TOPOLOGY
from preshape.hal.can.vocabulary import ModuleState
from preshape.sim_backend.joint_module import ModuleEvent
from preshape.sim_backend.modules_log import ModulesLog
from preshape.tools.modules_log_text import modules_log_lines

NODES = [module.node for module in TOPOLOGY.modules]


def test_what_happens_to_several_modules_at_once_is_one_line_and_silence_is_said_in_milliseconds() -> None:
    first, second = NODES[:2]
    events = [ModuleEvent(0, node, ModuleState.DISARMED, "power on") for node in NODES]
    events += [ModuleEvent(2_000_000_000, second, ModuleState.FAULT, "watchdog", 12_000_000)]
    events += [ModuleEvent(1_000_000_000, first, ModuleState.STOPPED, "quick stop", 2_000_000)]
    events += [ModuleEvent(2_000_000_000, first, ModuleState.FAULT, "watchdog", 12_000_000)]
    names = {module.node: module.name for module in TOPOLOGY.modules}
    assert modules_log_lines(ModulesLog(events, 0.934), TOPOLOGY) == [
        "the modules' log, in their own time:",
        "    0.000 s  disarmed (power on): all modules",
        f"    1.000 s  stopped (quick stop, 2 ms after the last command): {names[first]}",
        f"    2.000 s  fault (watchdog, 12 ms after the last command): {names[first]}, {names[second]}",
        "largest torque in physics: 0.93 of its limit",
    ]


def test_without_a_referee_nothing_is_said_of_torque() -> None:
    assert len(modules_log_lines(ModulesLog([]), TOPOLOGY)) == 1
