"""The box's pose now, from noisy, biased, delayed samples: the mean in the frame the box is fixed to.

On the table the box is fixed to the world, in a grasp to the holding palm. Each sample is brought into that frame at
its own time, where the pose is constant, so delay and the hand's motion drop out; noise averages away.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass

import numpy as np

from preshape.hal.transform import Matrix, exp_so3, inverse, length, log_so3
from preshape.hal.world import PoseSample


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Standard deviations of a sample's white noise (m, rad), and how the mean follows.

    `static_gain`, `held_gain`: the least weight of a new sample; `gate`: how many standard deviations make an outlier;
    `jump_samples`: how many outliers in a row that agree with each other replace the estimate; `settle_samples`: how
    many samples an estimate needs; `stale_s`: the age from which an estimate is no longer settled; `history_s`: how
    long the palm's motion is remembered.
    """

    sigma_m: float = 0.002
    sigma_rad: float = float(np.deg2rad(2.0))
    static_gain: float = 0.02
    held_gain: float = 0.03
    gate: float = 5.0
    jump_samples: int = 8
    settle_samples: int = 20
    stale_s: float = 0.25
    history_s: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class BoxEstimate:
    """The box's pose at `time_ns`, resting on samples up to `stamp_ns`.

    `settled`: enough agreeing samples, none contradicting, not stale. `jumps` counts how often the estimate was
    replaced at once: who planned on an older count should plan again.
    """

    time_ns: int
    stamp_ns: int
    X_world_box: Matrix
    settled: bool
    jumps: int

    @property
    def age_ns(self) -> int:
        """How old the newest sample in the estimate is."""
        return self.time_ns - self.stamp_ns


def interpolate_pose(X_a: Matrix, X_b: Matrix, share: float) -> Matrix:
    """Return the pose a share of the way from X_a to X_b: straight in position, R_a exp(share log(R_a^T R_b))."""
    X = np.eye(4)
    X[:3, 3] = (1 - share) * X_a[:3, 3] + share * X_b[:3, 3]
    X[:3, :3] = X_a[:3, :3] @ exp_so3(share * log_so3(X_a[:3, :3].T @ X_b[:3, :3]))
    return X


class PalmHistory:
    """The holding palm's measured poses of the last moments."""

    def __init__(self, span_ns: int) -> None:
        """Remember `span_ns` back from the newest."""
        self._span_ns = span_ns
        self._stamps: list[int] = []
        self._poses: list[Matrix] = []

    def add(self, stamp_ns: int, X_world_palm: Matrix) -> None:
        """Append a pose; one that is not newer than the last is ignored."""
        if self._stamps and stamp_ns <= self._stamps[-1]:
            return
        self._stamps.append(stamp_ns)
        self._poses.append(X_world_palm.copy())
        if self._stamps[0] < stamp_ns - 2 * self._span_ns:
            keep = bisect_right(self._stamps, stamp_ns - self._span_ns) - 1
            del self._stamps[:keep], self._poses[:keep]

    def at(self, time_ns: int) -> Matrix | None:
        """Return the pose at a time, interpolated; the newest for later times, None before the oldest."""
        after = bisect_right(self._stamps, time_ns)
        if after == 0:
            return None
        if after == len(self._stamps):
            return self._poses[-1]
        t0, t1 = self._stamps[after - 1], self._stamps[after]
        return interpolate_pose(self._poses[after - 1], self._poses[after], (time_ns - t0) / (t1 - t0))


class ObjectFilter:
    """Filters box pose samples; time is always passed in.

    Per tick: `palm` (while held), `observe` each new sample, `estimate`. Mean in the frame the box is fixed to:
    X <- X + g (sample - X) with g = max(1/n, gain) after the n-th sample.
    """

    def __init__(self, settings: FilterSettings | None = None) -> None:
        """Start without an estimate, on the table."""
        self._settings = settings or FilterSettings()
        self._palm: PalmHistory | None = None
        self._X_anchor_box: Matrix | None = None
        self._anchored_ns = -(2**62)
        self._stamp_ns = -(2**62)
        self._count = 0
        self._jumps = 0
        self._outliers: deque[Matrix] = deque(maxlen=self._settings.jump_samples)
        self._drift = np.zeros(6)
        self._bias = np.zeros(6)

    def hold(self, now_ns: int, X_world_palm: Matrix) -> None:
        """From now on the box moves with this palm; the estimate stays where it is. Also for a change of hands."""
        X_world_box = self._pose(now_ns)
        self._palm = PalmHistory(round(self._settings.history_s * 1e9))
        self._palm.add(now_ns, X_world_palm)
        self._anchor(now_ns, None if X_world_box is None else inverse(X_world_palm) @ X_world_box)

    def release(self, now_ns: int) -> None:
        """From now on the box stands still in the world."""
        X_world_box = self._pose(now_ns)
        self._palm = None
        self._anchor(now_ns, X_world_box)

    def palm(self, stamp_ns: int, X_world_palm: Matrix) -> None:
        """Take the holding palm's measured pose; `RuntimeError` when no hand holds."""
        if self._palm is None:
            raise RuntimeError("palm: the box is not held; call hold first")
        self._palm.add(stamp_ns, X_world_palm)

    def observe(self, sample: PoseSample) -> None:
        """Take a sample; old ones, not finite ones, and those from before the present hold or release are ignored."""
        if sample.stamp_ns <= self._stamp_ns or sample.stamp_ns < self._anchored_ns:
            return
        if not np.all(np.isfinite(sample.X_world_box)):
            return
        X_world_anchor = self._anchor_pose(sample.stamp_ns)
        if X_world_anchor is None:
            return
        self._stamp_ns = sample.stamp_ns
        X = inverse(X_world_anchor) @ _changed(sample.X_world_box, -self._bias)
        if self._X_anchor_box is None:
            self._restart([X])
            return
        difference = _difference(self._X_anchor_box, X)
        if self._deviation(difference) > self._settings.gate:
            self._take_outlier(X)
        else:
            self._outliers.clear()
            self._X_anchor_box = _moved(self._X_anchor_box, self._gain(difference) * difference)

    def correct(self, seen_ns: int, X_world_seen: Matrix) -> bool:
        """Take a pose from an image as true: the estimate moves there, the difference is the samples' bias from now on.

        The bias is taken as constant in the world: p' = p + b, R' = exp(w) R. Returns whether it was taken: not
        without an estimate, nor when the difference is too large for a bias (beyond the outlier gate).
        """
        X_world_anchor = self._anchor_pose(seen_ns)
        if X_world_anchor is None or self._X_anchor_box is None:
            return False
        bias = self._bias + _difference_world(X_world_seen, X_world_anchor @ self._X_anchor_box)
        if not self._deviation(bias) <= self._settings.gate:
            return False
        self._bias = bias
        self._X_anchor_box = inverse(X_world_anchor) @ X_world_seen
        self._outliers.clear()
        self._drift = np.zeros(6)
        return True

    def estimate(self, now_ns: int) -> BoxEstimate | None:
        """Return the pose at `now_ns`, None before the first sample."""
        X_world_box = self._pose(now_ns)
        if X_world_box is None:
            return None
        settings = self._settings
        fresh = now_ns - self._stamp_ns <= settings.stale_s * 1e9
        settled = self._count >= settings.settle_samples and len(self._outliers) < 3 and fresh
        return BoxEstimate(now_ns, self._stamp_ns, X_world_box, settled, self._jumps)

    def _anchor(self, now_ns: int, X_anchor_box: Matrix | None) -> None:
        self._X_anchor_box = X_anchor_box
        self._anchored_ns = now_ns
        self._outliers.clear()
        self._drift = np.zeros(6)

    def _anchor_pose(self, time_ns: int) -> Matrix | None:
        return np.eye(4) if self._palm is None else self._palm.at(time_ns)

    def _pose(self, now_ns: int) -> Matrix | None:
        X_world_anchor = self._anchor_pose(now_ns)
        if X_world_anchor is None or self._X_anchor_box is None:
            return None
        return X_world_anchor @ self._X_anchor_box

    def _sigma(self) -> Matrix:
        return np.repeat([self._settings.sigma_m, self._settings.sigma_rad], 3)

    def _deviation(self, difference: Matrix) -> float:
        """Return the larger of the position's and the turn's distance over their standard deviations."""
        scaled = difference / self._sigma()
        return max(length(scaled[:3]), length(scaled[3:]))

    def _take_outlier(self, X: Matrix) -> None:
        self._outliers.append(X)
        if len(self._outliers) < self._settings.jump_samples:
            return
        poses = list(self._outliers)
        mean = _mean(poses)
        if max(self._deviation(_difference(mean, pose)) for pose in poses) <= self._settings.gate:
            self._jumps += 1
            self._restart(poses)

    def _restart(self, poses: list[Matrix]) -> None:
        self._X_anchor_box, self._count = _mean(poses), len(poses)
        self._outliers.clear()
        self._drift = np.zeros(6)

    def _gain(self, difference: Matrix) -> float:
        """Return the weight of a sample; a larger one when the last ones lie off to one side beyond chance."""
        self._drift += 0.2 * (difference - self._drift)
        # A mean of weight 0.2 has a third of a sample's standard deviation; 2 sigma_sample = 6 of its own.
        if self._deviation(self._drift) > 2.0:
            self._count = min(self._count, 4)
        self._count += 1
        least = self._settings.static_gain if self._palm is None else self._settings.held_gain
        return max(1.0 / self._count, least)


def _difference(X_a: Matrix, X_b: Matrix) -> Matrix:
    """Return (p_b - p_a, log(R_a^T R_b)), the latter in frame a."""
    return np.concatenate([X_b[:3, 3] - X_a[:3, 3], log_so3(X_a[:3, :3].T @ X_b[:3, :3])])


def _moved(X: Matrix, step: Matrix) -> Matrix:
    out = X.copy()
    out[:3, 3] += step[:3]
    out[:3, :3] = X[:3, :3] @ exp_so3(step[3:])
    return out


def _difference_world(X_a: Matrix, X_b: Matrix) -> Matrix:
    """Return (p_b - p_a, log(R_b R_a^T)), the latter in the world's frame."""
    return np.concatenate([X_b[:3, 3] - X_a[:3, 3], log_so3(X_b[:3, :3] @ X_a[:3, :3].T)])


def _changed(X: Matrix, change: Matrix) -> Matrix:
    out = X.copy()
    out[:3, 3] += change[:3]
    out[:3, :3] = exp_so3(change[3:]) @ X[:3, :3]
    return out


def _mean(poses: list[Matrix]) -> Matrix:
    """Return the mean of poses that lie close together."""
    mean = poses[0]
    for _ in range(3):
        mean = _moved(mean, np.mean([_difference(mean, pose) for pose in poses], axis=0))
    return mean
