"""What a run shows while it goes on: a bar over the tasks on a terminal, one line per phase elsewhere."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from threading import Event, Thread
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from preshape.hal.tick_record import TickRecord

INTERVAL_S = 0.2
"""Time between two looks at what the run has done, s."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The beginning of a phase: loop time since the first tick (s), task, its name, phase."""

    time_s: float
    task: int
    name: str
    phase: str

    def __str__(self) -> str:
        return f"{self.time_s:7.2f} s  task {self.task} {self.name}: {self.phase}"


class PhaseWatch:
    """The observer: notes each new phase without waiting, for another thread to take."""

    def __init__(self, names: Mapping[int, str]) -> None:
        """Start with nothing noted; `names` are the tasks'."""
        self._names = names
        self.moments: deque[Moment] = deque()
        self._start_ns: int | None = None
        self._doing: tuple[object, object] | None = None

    def notify(self, record: TickRecord) -> None:
        """Take note of one tick."""
        doing = record["task"].item(), record["phase"].item()
        if doing == self._doing or not doing[0]:
            return
        now_ns = int(record["now_ns"])
        self._start_ns = now_ns if self._start_ns is None else self._start_ns
        self._doing = doing
        time_s, name = (now_ns - self._start_ns) * 1e-9, self._names.get(doing[0], "")
        self.moments.append(Moment(time_s, doing[0], name, doing[1].decode("ascii")))


class _View(Protocol):
    def show(self, moment: Moment) -> None: ...

    def refresh(self) -> None: ...

    def close(self) -> None: ...


class _Lines:
    """One line per phase."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def show(self, moment: Moment) -> None:
        self._console.print(str(moment), highlight=False, markup=False)

    def refresh(self) -> None:
        """Nothing changes between two lines."""

    def close(self) -> None:
        """Lines stay as they are."""


class _Bar:
    """A bar that fills task by task."""

    def __init__(self, console: Console, tasks: int) -> None:
        columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
        self._progress = Progress(*columns, console=console, auto_refresh=False, transient=True)
        self._bar = self._progress.add_task("starting", total=tasks)
        self._progress.start()

    def show(self, moment: Moment) -> None:
        self._progress.update(self._bar, description=str(moment), completed=moment.task - 1)

    def refresh(self) -> None:
        self._progress.refresh()

    def close(self) -> None:
        self._progress.stop()


class RunProgress:
    """Shows a run on a console while inside; `watch` is the observer to give to the session."""

    def __init__(self, names: Mapping[int, str], console: Console | None = None) -> None:
        """Show tasks of these names on a console; standard output if none is given."""
        self._console = console or Console()
        self._tasks = len(names)
        self.watch = PhaseWatch(names)
        self._ended = Event()
        self._thread = Thread(target=self._run, name="progress", daemon=True)

    def __enter__(self) -> RunProgress:
        self._thread.start()
        return self

    def __exit__(self, *cause: object) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        view: _View = _Bar(self._console, self._tasks) if self._console.is_terminal else _Lines(self._console)
        ended = False
        while not ended:
            ended = self._ended.wait(INTERVAL_S)
            while self.watch.moments:
                view.show(self.watch.moments.popleft())
            view.refresh()
        view.close()
