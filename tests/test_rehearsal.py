"""A run in real time is rehearsed once, and again only when a kernel that it calls has changed."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from preshape.sim_backend.scenario import Scenario
from preshape.tools import rehearsal
from preshape.tools.run_options import RunOptions

SCENARIO = Scenario(name="any")


class Kernel:
    """What the rehearsal sees of a kernel: where it comes from."""

    def __init__(self, name: str) -> None:
        self.py_func = SimpleNamespace(__module__="preshape.control.some", __qualname__=name)


class InProcess:
    """An executor that runs what it is given here."""

    def __init__(self, **options: object) -> None:
        pass

    def __enter__(self) -> "InProcess":
        return self

    def __exit__(self, *cause: object) -> None:
        pass

    def submit(self, function, *arguments):
        return SimpleNamespace(result=lambda: function(*arguments))


@pytest.fixture
def rehearsed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[int]:
    """Two kernels kept under a path; a rehearsal calls the first of them. Returns the rehearsals done, by last task."""
    done: list[int] = []
    kernels = [(Kernel("called"), tmp_path / "v1-called"), (Kernel("uncalled"), tmp_path / "v1-uncalled")]

    def rehearse(scenario: Scenario, seed: int, options: RunOptions) -> None:
        done.append(options.until_task)
        kernels[0][1].touch()

    monkeypatch.setattr(rehearsal, "KERNELS", kernels)
    monkeypatch.setattr(rehearsal, "cache_root", lambda: tmp_path)
    monkeypatch.setattr(rehearsal, "ProcessPoolExecutor", InProcess)
    monkeypatch.setattr(rehearsal, "_rehearse", rehearse)
    monkeypatch.setattr(rehearsal, "warm_up", lambda: 0)
    return done


def prepare(until_task: int = 5) -> bool:
    return rehearsal.prepare_kernels(SCENARIO, 0, RunOptions(until_task=until_task))


def test_is_rehearsed_once(rehearsed: list[int]) -> None:
    assert prepare()
    assert not prepare()
    assert rehearsed == [5]


def test_a_rehearsal_of_more_tasks_serves_for_fewer_but_not_the_other_way_round(rehearsed: list[int]) -> None:
    assert [prepare(1), prepare(1), prepare(3), prepare(2)] == [True, False, True, False]
    assert rehearsed == [1, 3]


def test_is_rehearsed_again_when_a_kernel_that_it_called_has_changed(
    rehearsed: list[int], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    prepare()
    unchanged = [(Kernel("called"), tmp_path / "v1-called"), (Kernel("uncalled"), tmp_path / "v2-uncalled")]
    monkeypatch.setattr(rehearsal, "KERNELS", unchanged)
    assert not prepare()
    monkeypatch.setattr(rehearsal, "KERNELS", [(Kernel("called"), tmp_path / "v2-called"), unchanged[1]])
    assert prepare()


def test_is_rehearsed_each_time_where_nothing_can_be_kept(
    rehearsed: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rehearsal, "cache_root", lambda: None)
    assert prepare() and prepare()
    assert rehearsed == [5, 5]
