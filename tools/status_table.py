"""A robot's status as tables on a terminal."""

from __future__ import annotations

from rich.console import Group
from rich.table import Table
from rich.text import Text

from preshape.tools.telemetry_messages import Health, Spread
from preshape.tools.telemetry_requests import Status

_NOTHING = "-"


def status_table(status: Status) -> Group:
    """Return what the robot does, then how each of its parts is."""
    return Group(_headline(status), _parts(status), _warning(status))


def _headline(status: Status) -> Text:
    task = status.task
    doing = "waits" if task is None else f"{task.mode}, task {task.task} {task.task_name}, {task.phase or 'no phase'}"
    return Text(f"robot {status.robot} on {status.device}: {doing}", style="bold")


def _warning(status: Status) -> Text:
    """Return what is wrong, in one line; empty if nothing is."""
    wrong = [f"{part} is {state}" for part, state in status.parts.items() if state != "running"]
    wrong += [f"stop asked for: {status.stop_reason}"] if status.stop_reason else []
    wrong += [status.joints.fault] if status.joints is not None and status.joints.fault else []
    return Text("; ".join(wrong), style="red")


def _parts(status: Status) -> Table:
    table = Table(box=None, pad_edge=False)
    for name in (
        "part",
        "state",
        "rate",
        "jitter",
        "lateness",
        "compute",
        "age",
        "overruns",
        "drops",
        "bus",
        "hottest",
    ):
        table.add_column(name, justify="left" if name in ("part", "state") else "right")
    for health in (status.loop, status.joints, *status.buses, status.telemetry):
        if health is not None:
            table.add_row(*_row(health))
    table.caption = "p50 / p99 over the last second; rate Hz; jitter, lateness, compute us; age ms; bus load %; degC"
    return table


def _row(health: Health) -> tuple[str, ...]:
    hottest = _NOTHING
    if health.temperature_c:
        sensor, degrees = max(health.temperature_c.items(), key=lambda pair: pair[1])
        hottest = f"{degrees:.0f} {sensor}"
    return (
        health.device,
        health.status,
        f"{health.rate_hz:.0f}",
        _spread(health.jitter_us, 0),
        _spread(health.lateness_us, 0),
        _spread(health.compute_us, 0),
        _spread(health.age_ms, 1),
        _count(health.overruns),
        _count(health.drops),
        _NOTHING if health.bus_load is None else f"{health.bus_load:.0%} {health.bus_errors or 0} err",
        hottest,
    )


def _count(value: int | None) -> str:
    return _NOTHING if value is None else str(value)


def _spread(spread: Spread | None, digits: int) -> str:
    return _NOTHING if spread is None else f"{spread.p50:.{digits}f} / {spread.p99:.{digits}f}"
