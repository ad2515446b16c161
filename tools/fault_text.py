"""What is to go wrong on the bus, as it is written on the command line: a named campaign, or a list of faults.

`drop=0.01,jitter_ms=2` are chances and times for every frame; `node_death=right_fore@task3+0.5` is an event, with
`/0.2` behind it one that lasts 0.2 s; `@12.5` is a time since the run began.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TypeVar

from preshape.hal.can.topology import TOPOLOGY, Topology
from preshape.sim_backend.fault_plan import CHANCES, FaultEvent, FaultKind, FaultPlan, FrameFaults
from preshape.tools.configuration_error import ConfigurationError

HOLDING = {1: "right", 2: "right", 3: "left", 4: "left", 5: "left"}
"""Task -> the hand that carries the box in it, or is about to."""

CAMPAIGNS: Mapping[str, str] = MappingProxyType(
    {
        "none": "",
        "loss1": "drop=0.01",
        "loss5": "drop=0.05",
        "jitter2": "jitter_ms=2",
        "corrupt1": "corrupt=0.01",
        "double1": "duplicate=0.01",
        "reorder1": "reorder=0.01",
        "bad_wire": "drop=0.01,duplicate=0.01,reorder=0.01,corrupt=0.01,jitter_ms=1",
        "finger_reboots": "node_reboot=right_fore@task3+0.5/0.2",
        "sensor_freezes": "torque_freeze=right_fore@task2",
        "sensor_drifts": "torque_drift=right_fore:0.02@task2",
        "host_stalls": "host_stall_ms=8@task3+0.5",
        **{f"finger_dies{task}": f"node_death={side}_fore@task{task}+0.5" for task, side in HOLDING.items()},
        **{f"host_hangs{task}": f"host_stall_ms=200@task{task}+0.5" for task in HOLDING},
        **{f"bus_off{task}": f"bus_off={side}_hand@task{task}+0.5" for task, side in HOLDING.items()},
    }
)
"""Campaigns by name."""

TIMES = {"delay_ms": "delay_s", "jitter_ms": "jitter_s"}
EVENTS = ("bus_off", "node_death", "node_reboot", "torque_freeze", "torque_drift", "host_stall_ms")
Made = TypeVar("Made")
_WHEN = re.compile(r"(?:task(?P<task>[1-5])(?:\+(?P<after>[0-9.]+))?|(?P<run>[0-9.]+))(?:/(?P<lasts>[0-9.]+))?")
WHEN_FORM = "NAME@WHEN, WHEN is seconds, taskN or taskN+SECONDS, with /SECONDS behind it where it ends"


def parse_faults(text: str, topology: Topology = TOPOLOGY) -> FaultPlan:
    """Return the plan that a text names; an empty text: nothing goes wrong.

    Raises:
        ConfigurationError: something in it is not known, not allowed, or there twice.
    """
    frames: dict[str, float] = {}
    events: list[FaultEvent] = []
    for entry in filter(None, CAMPAIGNS.get(text, text).split(",")):
        name, equals, value = (part.strip() for part in entry.partition("="))
        known = (*CHANCES, *TIMES, *EVENTS)
        if not equals or name not in known:
            allowed = f"a campaign ({', '.join(CAMPAIGNS)}) or NAME=VALUE, with NAME one of {', '.join(known)}"
            raise ConfigurationError(f"--faults: got {entry!r}, allowed is {allowed}")
        if name in frames:
            raise ConfigurationError(f"--faults: got {name} twice, allowed is once")
        if name in EVENTS:
            events.append(_checked(lambda name=name, value=value: _event(name, value, topology)))
        else:
            frames[name] = _number(name, value)
    return FaultPlan(frames=_checked(lambda: _frame_faults(frames)), events=tuple(events))


def _frame_faults(values: Mapping[str, float]) -> FrameFaults:
    """Return the faults in SI units."""
    chances = {name: value for name, value in values.items() if name not in TIMES}
    return FrameFaults(**chances, **{TIMES[name]: 1e-3 * value for name, value in values.items() if name in TIMES})


def _event(name: str, text: str, topology: Topology) -> FaultEvent:
    target, at, when = text.partition("@")
    match = _WHEN.fullmatch(when)
    if not at or match is None:
        raise ConfigurationError(f"--faults: {name}: got {text!r}, allowed is {WHEN_FORM}")
    task, after_s = int(match["task"] or 0), _number(name, match["after"] or match["run"] or "0")
    lasts_s = math.inf if match["lasts"] is None else _number(name, match["lasts"])
    if name == "host_stall_ms":
        if match["lasts"] is not None:
            raise ConfigurationError(f"--faults: {name}: got {text!r}, allowed is MILLISECONDS@WHEN without an end")
        return FaultEvent(kind=FaultKind.HOST_STALL, task=task, after_s=after_s, lasts_s=_number(name, target) * 1e-3)
    if name == "node_reboot" and match["lasts"] is None:
        raise ConfigurationError(f"--faults: {name}: got {text!r}, allowed is NAME@WHEN/SECONDS: when it starts again")
    kind = FaultKind.NODE_DEATH if name == "node_reboot" else FaultKind(name)
    rate = 0.0
    if kind is FaultKind.TORQUE_DRIFT:
        target, _, speed = target.partition(":")
        rate = _number(f"{name} of {target}, N m/s", speed)
    names = [bus.name for bus in topology.buses] if kind is FaultKind.BUS_OFF else _module_names(topology)
    if target not in names:
        raise ConfigurationError(f"--faults: {name}: got {target!r}, allowed are {', '.join(names)}")
    return FaultEvent(kind=kind, target=target, task=task, after_s=after_s, lasts_s=lasts_s, rate=rate)


def _module_names(topology: Topology) -> Sequence[str]:
    return [module.name for module in topology.modules]


def _number(name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise ConfigurationError(f"--faults: {name}: got {text!r}, allowed is a number") from None
    if not math.isfinite(number):
        raise ConfigurationError(f"--faults: {name}: got {text!r}, allowed is a finite number")
    return number


def _checked(make: Callable[[], Made]) -> Made:
    """Return what is made; a value out of range is an error of the configuration."""
    try:
        return make()
    except ValueError as error:
        raise ConfigurationError(f"--faults: {error}") from None
