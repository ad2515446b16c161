"""Laws of the storyboard: what is kept during a run, which 14 moments are shown, what the picture holds."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from preshape.tools.storyboard import FRAMES, Snapshot, StoryboardRecorder, pick_frames
from preshape.tools.storyboard_picture import caption_of, storyboard_picture

Stage = tuple[int, str, float]

RUN: list[Stage] = [
    (1, "approach", 1.0), (1, "grasp", 0.5), (1, "lift", 1.0),
    (2, "carry", 1.0), (2, "roll", 2.0), (2, "look", 0.1),
    (3, "approach", 2.0), (3, "preshape", 1.0), (3, "grasp", 0.5), (3, "release", 1.0),
    (4, "approach", 1.0), (4, "crush", 0.5), (4, "retreat", 0.7),
    (5, "insert", 1.0), (5, "pinch", 0.5), (5, "turn", 2.0),
]  # fmt: skip


def recorded(stages: list[Stage], period_s: float = 0.01) -> list[Snapshot]:
    """Return the snapshots of a run whose first position is the time."""
    recorder, time_s = StoryboardRecorder(), 0.0
    for task, phase, duration_s in stages:
        for _ in range(round(duration_s / period_s)):
            recorder.feed(time_s, task, phase, np.array([time_s, 0.0]))
            time_s += period_s
    return recorder.snapshots()


def test_keeps_the_last_moment_of_every_phase() -> None:
    closing = [(s.task, s.phase) for s in recorded(RUN) if s.closes]
    assert closing == [(task, phase) for task, phase, _ in RUN]


def test_snapshots_are_copies_in_the_order_of_time() -> None:
    recorder = StoryboardRecorder(interval_s=0.1)
    qpos = np.zeros(1)
    for tick in range(200):
        qpos[0] = tick
        recorder.feed(tick * 0.01, 1, "a" if tick < 77 else "b", qpos)
    kept = recorder.snapshots()
    assert all(s.qpos[0] == round(s.time_s / 0.01) for s in kept)
    assert np.all(np.diff([s.time_s for s in kept]) >= 0)
    assert np.max(np.diff([s.time_s for s in kept])) <= 0.1 + 0.01 + 1e-9
    assert len(kept) < 30, "a low rate, not every tick"


def test_whole_run_gives_14_frames_with_the_tasks_of_fig_6() -> None:
    frames = pick_frames(recorded(RUN))
    assert len(frames) == FRAMES == 14
    assert [s.task for s in frames] == [1, 1, 2, 2, 2, 3, 3, 3, 3, 3, 3, 4, 5, 5]
    assert np.all(np.diff([s.time_s for s in frames]) > 0)


def test_each_task_is_shown_at_its_end() -> None:
    snapshots = recorded(RUN)
    ends = {s.task: s for s in snapshots}
    shown = {s.task: s for s in pick_frames(snapshots)}
    assert {task: s.time_s for task, s in shown.items()} == {task: s.time_s for task, s in ends.items()}


def test_named_phase_stands_for_the_end_of_its_task() -> None:
    frames = pick_frames(recorded(RUN), {4: "crush"})
    assert frames[11].phase == "crush"
    assert frames[11].closes
    assert len(frames) == FRAMES


def test_retried_tasks_are_shown_by_their_last_attempt() -> None:
    retried = [*RUN[:2], (1, "dropped", 0.5), (0, "replan", 0.3), *RUN]
    frames = pick_frames(recorded(retried))
    assert len(frames) == FRAMES
    assert frames[0].time_s == pytest.approx(2.3)


def test_failed_run_ends_with_its_last_moment() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        stages = RUN[: rng.integers(1, len(RUN))]
        snapshots = recorded(stages)
        frames = pick_frames(snapshots)
        assert 2 <= len(frames) <= FRAMES
        assert frames[-1].time_s == snapshots[-1].time_s


def test_nothing_recorded_gives_no_frames() -> None:
    assert pick_frames(StoryboardRecorder().snapshots()) == []


def test_picture_shows_every_frame_in_its_own_state() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body name='box' pos='.3 0 .3'><joint type='slide' axis='0 1 0'/>"
        "<geom type='box' size='.1 .1 .1' rgba='1 0 0 1'/></body></worldbody></mujoco>"
    )
    frames = [Snapshot(float(k), 1, "p", np.array([0.1 * k])) for k in range(3)]
    sheet = storyboard_picture(model, frames, inset=None, width=80, height=60, columns=3)
    columns = []
    for k in range(3):
        cell = sheet[6:66, 6 + 86 * k : 86 + 86 * k].astype(int)
        columns.append(np.nonzero(cell[..., 0] - cell[..., 2] > 40)[1].mean())
    assert columns[0] < columns[1] < columns[2]


def test_caption_names_number_time_task_and_phase() -> None:
    assert caption_of(3, Snapshot(4.25, 2, "roll", np.zeros(1))) == "(3)  4.25 s   task 2 show: roll"
