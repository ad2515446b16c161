"""Laws of the safety gate: what leaves it never breaks a limit, and a stop stays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from preshape.hal.gate import LIMITS, SafetyGate
from preshape.hal.gate_config import AgeTier, GateConfig, GateVerdict
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, RobotState

PERIOD_NS = 2_000_000
DT = PERIOD_NS * 1e-9
MIDDLE = 0.5 * (LAYOUT.lower + LAYOUT.upper)
TORQUE = 0.5 * LAYOUT.torque
NAN = np.full(LAYOUT.dof, np.nan)


def _state(now_ns: int, position: np.ndarray = MIDDLE, **changes: object) -> RobotState:
    values: dict[str, object] = {
        "sequence": 0,
        "position": position,
        "velocity": np.zeros(LAYOUT.dof),
        "torque": np.zeros(LAYOUT.dof),
        "stamp_ns": np.full(LAYOUT.dof, now_ns),
        "status": DeviceStatus.ARMED,
    }
    return RobotState(**{**values, **changes})  # type: ignore[arg-type]


def _armed(position: np.ndarray = MIDDLE, config: GateConfig | None = None) -> SafetyGate:
    gate = SafetyGate(config)
    assert gate.arm(0, _state(0, position))
    return gate


def _changed(values: np.ndarray, index: int, value: float) -> np.ndarray:
    out = values.copy()
    out[index] = value
    return out


def test_holds_measured_position_before_first_command() -> None:
    gate = SafetyGate()
    for tick, offset in enumerate((0.0, 0.01, 0.02)):
        verdict = gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS, MIDDLE + offset), MIDDLE, TORQUE)
        assert verdict is GateVerdict.DISARMED
        assert np.array_equal(gate.position, MIDDLE + offset)
        assert not gate.torque_limit.any()


def test_starts_from_the_measured_position_when_armed_and_holds_it_without_a_request() -> None:
    gate = _armed(MIDDLE + 0.01)
    for tick in range(1, 4):
        assert gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS)) is GateVerdict.BRAKED
        assert np.array_equal(gate.position, MIDDLE + 0.01)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), reach=st.floats(1e-4, 3.0))
def test_every_armed_output_keeps_position_velocity_and_acceleration_limits(seed: int, reach: float) -> None:
    rng = np.random.default_rng(seed)
    position = rng.uniform(LAYOUT.lower, LAYOUT.upper)
    gate = _armed(position, GateConfig(velocity_gross=1e9, position_gross_rad=1e9, torque_gross=1e9))
    last, step = gate.position.copy(), np.zeros(LAYOUT.dof)
    target = position.copy()
    for tick in range(1, 60):
        if tick % 7 == 1:
            target = position + rng.uniform(-reach, reach, LAYOUT.dof)
        torque = rng.uniform(-2.0, 3.0) * LAYOUT.torque
        gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS), target if tick < 50 else None, torque)
        moved = gate.position - last
        assert (gate.position >= LAYOUT.lower).all() and (gate.position <= LAYOUT.upper).all()
        assert (np.abs(moved) <= LAYOUT.velocity * DT + 1e-12).all()
        bounded = np.abs(moved - step) <= LAYOUT.acceleration * DT * DT + 1e-12
        at_limit = (gate.position == LAYOUT.lower) | (gate.position == LAYOUT.upper)
        assert (bounded | at_limit).all()
        assert (gate.torque_limit >= 0.0).all() and (gate.torque_limit <= LAYOUT.torque).all()
        last, step = gate.position.copy(), moved


def test_a_request_within_all_limits_passes_unchanged() -> None:
    gate = _armed()
    for tick in range(1, 200):
        wanted = MIDDLE + 0.02 * (1 - np.cos(0.02 * tick))
        assert gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS), wanted, TORQUE) is GateVerdict.PASSED
        assert np.allclose(gate.position, wanted, atol=1e-12)
        assert np.array_equal(gate.torque_limit, TORQUE)
    assert not any(gate.counts.values())


def test_a_joint_outside_its_limits_may_return_but_never_go_farther_out() -> None:
    outside = _changed(MIDDLE, 9, LAYOUT.upper[9] + 0.03)
    gate = _armed(outside)
    gate.check(PERIOD_NS, _state(PERIOD_NS), _changed(outside, 9, LAYOUT.upper[9] + 0.031), TORQUE)
    assert gate.position[9] <= outside[9]
    for tick in range(2, 1500):
        request = _changed(outside, 9, max(LAYOUT.upper[9] - 0.1, gate.position[9] - 1e-4))
        assert gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS), request, TORQUE) <= GateVerdict.CLIPPED
    assert gate.position[9] < LAYOUT.upper[9]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("joint", [0, 13, 39])
def test_a_request_that_is_not_finite_stops_and_names_the_joint(value: float, joint: int) -> None:
    for position, torque in ((_changed(MIDDLE, joint, value), TORQUE), (MIDDLE, _changed(TORQUE, joint, value))):
        gate = _armed()
        assert gate.check(PERIOD_NS, _state(PERIOD_NS, MIDDLE + 0.01), position, torque) is GateVerdict.STOPPED
        assert LAYOUT.names[joint] in gate.reason
        assert np.array_equal(gate.position, MIDDLE + 0.01)


@pytest.mark.parametrize("field", ["position", "velocity", "torque"])
def test_a_measurement_that_is_not_finite_stops_and_the_output_stays_finite(field: str) -> None:
    gate = _armed()
    state = _state(PERIOD_NS, **{field: _changed(np.zeros(LAYOUT.dof), 3, np.nan)})
    assert gate.check(PERIOD_NS, state, MIDDLE, TORQUE) is GateVerdict.STOPPED
    assert field in gate.reason and LAYOUT.names[3] in gate.reason
    assert np.isfinite(gate.position).all()


@pytest.mark.parametrize(
    ("position", "torque", "word"),
    [
        (_changed(MIDDLE, 2, MIDDLE[2] + 4 * LAYOUT.velocity[2] * DT), TORQUE, "speed"),
        (_changed(MIDDLE, 2, LAYOUT.upper[2] + 0.2), TORQUE, "speed"),
        (MIDDLE, _changed(TORQUE, 2, 3 * LAYOUT.torque[2]), "torque limit"),
    ],
)
def test_a_gross_request_stops_instead_of_being_clipped(position: np.ndarray, torque: np.ndarray, word: str) -> None:
    gate = _armed()
    assert gate.check(PERIOD_NS, _state(PERIOD_NS), position, torque) is GateVerdict.STOPPED
    assert word in gate.reason and LAYOUT.names[2] in gate.reason


def test_a_request_far_outside_the_limits_stops_even_when_it_is_near_the_last_output() -> None:
    start = _changed(MIDDLE, 0, LAYOUT.upper[0] + 0.2)
    gate = _armed(start)
    assert gate.check(PERIOD_NS, _state(PERIOD_NS), start + 1e-4, TORQUE) is GateVerdict.STOPPED
    assert "outside the limits" in gate.reason


def test_age_tiers_warn_then_freeze_then_tighten_then_stop() -> None:
    gate = _armed()
    velocity = 0.05 * LAYOUT.velocity
    tick = 0
    for tick in range(1, 100):
        wanted = gate.position + np.minimum(np.abs(gate.step) + 0.5 * LIMITS.acceleration * DT * DT, velocity * DT)
        assert gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS), wanted, TORQUE) is GateVerdict.PASSED
    stamp, seen = tick * PERIOD_NS, {}
    for later in range(tick + 1, tick + 60):
        before = gate.position.copy()
        verdict = gate.check(later * PERIOD_NS, _state(stamp), before, TORQUE)
        seen.setdefault(gate.age_tier, (later * PERIOD_NS - stamp) * 1e-9)
        if gate.age_tier is AgeTier.FREEZE:
            assert verdict is GateVerdict.BRAKED and np.array_equal(gate.torque_limit, TORQUE)
        elif gate.age_tier is AgeTier.HOLD:
            assert verdict is GateVerdict.BRAKED and gate.at_rest
            assert np.allclose(gate.torque_limit, TORQUE * gate.config.hold_torque_ratio)
        elif gate.age_tier is AgeTier.STOP:
            assert verdict is GateVerdict.STOPPED and "stale" in gate.reason
    config = gate.config
    ages = [config.warn_age_s, config.freeze_age_s, config.hold_age_s, config.stop_age_s]
    assert list(seen) == list(AgeTier)
    assert np.allclose(list(seen.values())[1:], ages)


def test_fresh_samples_lift_the_freeze_without_a_step() -> None:
    gate = _armed()
    assert gate.check(15 * PERIOD_NS, _state(0), MIDDLE, TORQUE) is GateVerdict.BRAKED
    assert gate.check(16 * PERIOD_NS, _state(16 * PERIOD_NS), gate.position.copy(), TORQUE) is GateVerdict.PASSED


def test_the_watchdog_stops_when_checks_stay_away_or_time_runs_backwards() -> None:
    late = round(SafetyGate().config.watchdog_s * 1e9) + 1
    for now in (late, -1):
        gate = _armed()
        assert gate.check(now, _state(now), MIDDLE, TORQUE) is GateVerdict.STOPPED
        assert "watchdog" in gate.reason


def test_torque_above_the_limit_stops_only_when_it_lasts() -> None:
    over = _changed(np.zeros(LAYOUT.dof), 20, -1.3 * LAYOUT.torque[20])
    gate = _armed()
    verdicts = []
    for tick in range(1, 20):
        torque = np.zeros(LAYOUT.dof) if tick == 4 else over
        verdicts.append(gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS, torque=torque), MIDDLE, TORQUE))
    lasting = round(gate.config.torque_time_s / DT)
    assert verdicts.index(GateVerdict.STOPPED) == 4 + lasting - 1
    assert LAYOUT.names[20] in gate.reason and "torque" in gate.reason


def test_a_device_that_is_not_armed_stops_the_gate_with_its_fault() -> None:
    gate = _armed()
    state = _state(PERIOD_NS, status=DeviceStatus.FAULT, fault="node 3 lost")
    assert gate.check(PERIOD_NS, state, MIDDLE, TORQUE) is GateVerdict.STOPPED
    assert "node 3 lost" in gate.reason


def test_a_stop_is_latched_with_its_first_reason_until_armed_again() -> None:
    gate = _armed()
    gate.stop("operator")
    gate.stop("something later")
    for tick in range(1, 50):
        measured = MIDDLE + 1e-3 * tick
        assert gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS, measured), MIDDLE, TORQUE) is GateVerdict.STOPPED
        assert np.array_equal(gate.position, measured) and gate.reason == "operator"
    assert gate.arm(50 * PERIOD_NS, _state(50 * PERIOD_NS, MIDDLE + 0.05))
    assert gate.reason == "" and np.array_equal(gate.position, MIDDLE + 0.05)
    assert gate.check(51 * PERIOD_NS, _state(51 * PERIOD_NS), MIDDLE + 0.05, TORQUE) is GateVerdict.PASSED


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"status": DeviceStatus.DISARMED}, "DISARMED"),
        ({"stamp_ns": np.full(LAYOUT.dof, -30_000_000)}, "stale"),
        ({"position": NAN}, "finite"),
    ],
)
def test_arming_is_refused_with_a_reason(changes: dict[str, object], word: str) -> None:
    gate = SafetyGate()
    assert not gate.arm(0, _state(0, **changes))  # type: ignore[arg-type]
    assert word in gate.reason and not gate.armed


def test_without_a_request_the_output_comes_to_rest_no_later_than_the_limits_demand() -> None:
    gate = _armed()
    for tick in range(1, 60):
        wanted = gate.position + np.minimum(
            np.abs(gate.step) + LIMITS.acceleration * DT * DT, 0.3 * LAYOUT.velocity * DT
        )
        gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS), wanted, TORQUE)
    needed = int(np.ceil((np.abs(gate.step) / (LIMITS.acceleration * DT * DT)).max()))
    for tick in range(60, 60 + needed + 1):
        assert gate.check(tick * PERIOD_NS, _state(tick * PERIOD_NS)) is GateVerdict.BRAKED
    assert gate.at_rest


def test_a_request_of_another_shape_is_the_callers_mistake() -> None:
    with pytest.raises(ValueError, match="shape"):
        _armed().check(PERIOD_NS, _state(PERIOD_NS), MIDDLE[:-1], TORQUE)


@pytest.mark.parametrize(
    "changes", [{"period_s": 0.0}, {"warn_age_s": np.nan}, {"freeze_age_s": 0.2}, {"hold_torque_ratio": 1.5}]
)
def test_thresholds_that_make_no_sense_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="allowed is"):
        GateConfig(**changes)  # type: ignore[arg-type]
