"""`report.html`: one static file that says first what came of the run and why, then shows it."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from preshape.hal.layout import SIDES
from preshape.hal.tick_record import TickRecord
from preshape.sim_backend.judged import judged
from preshape.sim_backend.referee_report import TaskTruth
from preshape.tools.report import LoopReport, Report
from preshape.tools.series import Series, distances, loop_times, torque_ratios
from preshape.tools.svg_plot import Plot, svg

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 960px; margin: 2em auto; padding: 0 1em; color: #222; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin: 1.8em 0 .4em; }
.outcome { padding: .7em 1em; border-left: 6px solid; margin: 1em 0; }
.done { background: #e9f5ec; border-color: #2e8b4a; } .failed { background: #fbeaea; border-color: #b83232; }
.outcome strong { font-size: 1.15em; }
table { border-collapse: collapse; } td, th { padding: .15em .9em .15em 0; text-align: left; vertical-align: top; }
th { font-weight: 600; border-bottom: 1px solid #ccc; } td.number { text-align: right; }
.bad { color: #b83232; font-weight: 600; } img, svg { max-width: 100%; height: auto; }
svg { display: block; margin: .6em 0; font: 11px system-ui, sans-serif; }
svg path { fill: none; stroke-width: 1.1; } svg .title { font-weight: 600; font-size: 12px; }
svg .grid { stroke: #ddd; } svg .level { stroke: #b83232; stroke-dasharray: 5 3; }
svg line.mark { stroke: #bbb; stroke-dasharray: 2 3; } svg text.mark { fill: #888; }
code { font-size: .9em; overflow-wrap: anywhere; } ul { margin: .3em 0; padding-left: 1.3em; }
"""

Cell = str | float | int


class Bad(str):
    """A text in a table that says what went wrong."""

    __slots__ = ()


def report_page(
    report: Report,
    storyboard: bytes | None = None,
    plan_picture: bytes | None = None,
    records: TickRecord | None = None,
    timing: NDArray[np.void] | None = None,
) -> str:
    """Return the page; pictures are PNG data, records and timing what a `TickBuffer` has kept."""
    title = f"{report.scenario.name}, seed {report.seed}"
    sections = [
        f"<h1>{escape(title)}</h1>",
        _outcome(report),
        _section("Tasks", _tasks(report)),
        _section("Storyboard", _picture(storyboard, "moments of the run")),
        _section("Referee", _referee(report)),
        _section("Plan", _picture(plan_picture, "the plan") + _plan(report)),
        _section("Torque and distance", _motion_plots(report, records)),
        _section("Loop", _loop_table(report.loop) + _loop_plot(timing)),
        _section("Notes", _list([*report.notes, *report.observer_failures])),
        _section("Run", _run_table(report)),
    ]
    body = "\n".join(section for section in sections if section)
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style>'
    return f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n'


def _section(title: str, content: str) -> str:
    return f"<h2>{title}</h2>\n{content}" if content else ""


def _outcome(report: Report) -> str:
    seconds = f"{report.sim.seconds:.1f} s simulated, {report.sim.realtime_factor:.2f} x real time"
    if report.success:
        return f'<div class="outcome done"><strong>{report.done.capitalize()}.</strong><br>{seconds}</div>'
    lines = [f"<strong>{escape(report.failure or 'failed')}</strong>"]
    if report.loop.outcome != "finished":
        lines.append(escape(f"loop: {report.loop.outcome}, {report.loop.reason}"))
    lines.append(seconds)
    return f'<div class="outcome failed">{"<br>".join(lines)}</div>'


def _table(head: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    def cell(value: Cell) -> str:
        kind = "bad" if isinstance(value, Bad) else "text" if isinstance(value, str) else "number"
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        return f'<td class="{kind}">{escape(text)}</td>'

    header = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "\n".join(f"<tr>{''.join(cell(value) for value in row)}</tr>" for row in rows)
    return f"<table><tr>{header}</tr>\n{body}</table>"


def _list(lines: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>" if lines else ""


def _picture(png: bytes | None, what: str) -> str:
    if png is None:
        return ""
    return f'<img alt="{escape(what)}" src="data:image/png;base64,{base64.b64encode(png).decode("ascii")}">\n'


def _tasks(report: Report) -> str:
    truth = {} if report.referee is None else {task.task: task for task in report.referee.tasks}
    rows: list[list[Cell]] = []
    for task in report.tasks:
        seen = _seen(truth.get(task.task))
        times = f"{task.start_s:.2f} .. {task.end_s:.2f} s" if task.attempts else ""
        outcome = task.outcome if task.outcome in ("done", "not asked") else Bad(task.outcome)
        rows.append([task.task, task.name, outcome, times, task.attempts, seen])
    return _table(["task", "", "controller", "time", "attempts", "referee"], rows)


def _seen(truth: TaskTruth | None) -> str:
    if truth is None:
        return "lost with the world"
    return "not done" if truth.end_s is None else f"done at {truth.end_s:.2f} s"


def _referee(report: Report) -> str:
    referee = report.referee
    if referee is None:
        return _list(["The world was lost, and the referee with it: nothing that happened in it is judged."])
    error = referee.opening_error
    found = "not reported" if error is None else f"{1e3 * error[0]:.1f} mm, {np.rad2deg(error[1]):.1f} deg"
    opening: list[list[Cell]] = [
        ["torn fraction", referee.torn_fraction, ">= 0.9"],
        ["lid angle at the end, deg", referee.lid_angle_deg, ">= 60"],
        ["tab pushed in, most, deg", referee.max_tab_angle_deg, ">= 30"],
        ["opening found, error", found, "<= 10 mm, 5 deg"],
        ["box moved by the regrasp, mm", referee.regrasp_motion_mm, ""],
    ]
    rows: list[list[Cell]] = [
        *(opening if judged(report.scenario.shape).passed_on else ()),
        ["slip in the holding hand, mm", referee.hold_slip_mm, "<= 5"],
        [f"torque over limit ({referee.max_torque_joint})", referee.max_torque_ratio, "<= 1.2 beyond 10 ms"],
        ["torque commanded over limit", referee.max_commanded_ratio, "<= 1"],
        ["largest load on a panel, N", max(referee.max_panel_load_n.values(), default=0.0), "below the crush load"],
        ["undesired contacts", len(referee.undesired_contacts), "0"],
    ]
    contacts = [f"{link} on {geom} at {time_s:.2f} s" for link, geom, time_s in referee.undesired_contacts]
    failures = _list(referee.failures)
    return failures + _table(["", "seen", "asked"], rows) + _list(contacts)


def _plan(report: Report) -> str:
    plan = report.plan
    tasks = [task.name for task in report.tasks]
    rows = [[f"p_{key}", *("*" if p is None else p for p in row)] for key, row in plan.priorities.items()]
    taken = [f"{block}: {component}" for block, component in plan.chosen.items()]
    grips = [f"{side}: {g.name} grip, palm on {g.palm}, fingers on {g.fingers}" for side, g in plan.grips.items()]
    return _table(["priority", *tasks], rows) + _list([*taken, *grips])


def _motion_plots(report: Report, records: TickRecord | None) -> str:
    if records is None or len(records) == 0:
        return ""
    time_s = _seconds(records["now_ns"])
    marks = [(task.start_s, task.name) for task in report.tasks if task.attempts]
    plots: list[Plot] = []
    for side in SIDES:
        title = f"{side} hand and arm: greatest torque over its limit"
        plots.append(Plot(title, "", time_s, torque_ratios(records, side), 1.0, marks))
    for side in SIDES:
        title = f"{side} hand: least distance to what it must not touch"
        series = distances(records, side)
        # A run that ends before an approach has measured none.
        if np.isfinite(series.values).any():
            plots.append(Plot(title, "m", time_s, series, None, marks))
    return "\n".join(svg(plot) for plot in plots)


def _loop_plot(timing: NDArray[np.void] | None) -> str:
    if timing is None or len(timing) == 0:
        return ""
    times: Series = loop_times(timing)
    return svg(
        Plot("lateness and compute time of every tick", "us", _seconds(timing["now_ns"]), times, logarithmic=True)
    )


def _seconds(now_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    return (now_ns - now_ns[0]) * 1e-9


def _loop_table(loop: LoopReport) -> str:
    rows: list[list[Cell]] = []
    for name, spread in (
        ("compute", loop.compute_us),
        ("lateness", loop.lateness_us),
        ("lateness of an empty loop", loop.empty_lateness_us),
    ):
        if spread is not None:
            rows.append([f"{name}, us", spread.p50, spread.p99, spread.p99_9, spread.max])
    counts = f"<p>{loop.ticks} ticks at {loop.rate_hz:g} Hz, {loop.overruns} overruns, {loop.held} held</p>"
    return counts + _table(["", "p50", "p99", "p99.9", "max"], rows)


def _run_table(report: Report) -> str:
    rows: list[list[Cell]] = [
        ["device", f"{report.device}, {'paced' if report.paced else 'lockstep'}"],
        ["version", report.version],
        ["commands sha256", report.commands_sha256],
    ]
    return _table(["", ""], rows)
