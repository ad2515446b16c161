"""The modules' log as text: what each change of state was, when, why, and after what silence."""

from __future__ import annotations

from itertools import groupby

from preshape.hal.can.topology import Topology
from preshape.sim_backend.joint_module import ModuleEvent
from preshape.sim_backend.modules_log import ModulesLog


def modules_log_lines(log: ModulesLog, topology: Topology) -> list[str]:
    """Return the log in lines; what happens to several modules in the same step, for the same reason, is one line."""
    names = {module.node: module.name for module in topology.modules}
    lines = ["the modules' log, in their own time:"]
    for (time_ns, what), events in groupby(sorted(log.events, key=_order), key=_line):
        nodes = [event.node for event in events]
        who = "all modules" if len(nodes) == len(names) else ", ".join(names[node] for node in nodes)
        lines.append(f"{time_ns * 1e-9:9.3f} s  {what}: {who}")
    if log.max_torque_ratio is not None:
        lines.append(f"largest torque in physics: {log.max_torque_ratio:.2f} of its limit")
    return lines


def _line(event: ModuleEvent) -> tuple[int, str]:
    silence = "" if event.silence_ns is None else f", {event.silence_ns * 1e-6:.0f} ms after the last command"
    return event.time_ns, f"{event.state.name.lower()} ({event.cause}{silence})"


def _order(event: ModuleEvent) -> tuple[tuple[int, str], int]:
    return _line(event), event.node
