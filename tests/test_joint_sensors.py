"""Link-side torques against inverse dynamics; what noise, counts and delay do."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from preshape.hal import sah_hand
from preshape.hal.layout import LAYOUT
from preshape.sim_backend.joint_sensors import ARM_POSITION_RESOLUTION
from preshape.sim_backend.robot_model import joint_addresses
from preshape.sim_backend.scenario import DisturbanceSection, FrozenSection, Scenario
from preshape.sim_backend.simulation import Simulation, home_position

ARM, HAND = LAYOUT.arm("right"), LAYOUT.hand("right")


@pytest.fixture
def simulation() -> Simulation:
    return Simulation(Scenario(name="sensors").drawn(0))


@pytest.mark.parametrize("torque_share", [1.0, 0.05])
def test_true_torque_is_what_inverse_dynamics_without_rotors_asks_for(
    simulation: Simulation, torque_share: float
) -> None:
    model, data = simulation.model, simulation.data
    qpos, dof = joint_addresses(model)
    dip = {LAYOUT.index(f"right_{f}_pip"): model.joint(f"right_{f}_dip").dofadr[0] for f in sah_hand.FINGERS}
    rng, copy = np.random.default_rng(1), mujoco.MjData(model)
    compared = clipped = 0
    for k in range(80):
        goal = home_position() + 0.05 * np.sin(0.05 * k) * rng.uniform(0.5, 1.0, LAYOUT.dof)
        simulation.drives.follow(goal, torque_share * LAYOUT.torque, 0.001)
        copy.qpos[:], copy.qvel[:] = data.qpos, data.qvel
        simulation.step()
        mujoco.mj_fwdPosition(model, copy)
        mujoco.mj_fwdVelocity(model, copy)
        copy.qacc[:] = (data.qvel - copy.qvel) / model.opt.timestep
        needed = np.zeros(model.nv)
        mujoco.mj_rne(model, copy, 1, needed)
        inside = (copy.qpos[qpos] > LAYOUT.lower + 2e-3) & (copy.qpos[qpos] < LAYOUT.upper - 2e-3)
        for joint in np.flatnonzero(inside)[np.flatnonzero(inside) < HAND.stop]:
            expected = needed[dof[joint]] + (needed[dip[joint]] if joint in dip else 0.0)
            assert simulation.joint_sensors.true_torque[joint] == pytest.approx(expected, abs=1e-8)
            compared += 1
            clipped += abs(data.actuator_force[joint]) >= torque_share * LAYOUT.torque[joint] - 1e-12
    assert compared > 700
    assert clipped > 100


def test_positions_come_in_counts_one_step_late(simulation: Simulation) -> None:
    goal = home_position() + 0.02
    history = []
    for _ in range(30):
        simulation.drives.follow(goal, LAYOUT.torque, 0.050)
        simulation.step()
        history.append(simulation.data.qpos[joint_addresses(simulation.model)[0]].copy())
        position = simulation.joint_sensors.read()[0]
        if len(history) > 1:
            error = np.abs(position - history[-2])
            assert error[ARM].max() <= ARM_POSITION_RESOLUTION / 2 + 1e-12
            assert error[HAND].max() <= sah_hand.POSITION_RESOLUTION / 2 + 1e-12
    assert simulation.time_ns - simulation.sample_ns == 1_000_000
    assert np.abs(history[-1] - history[0])[ARM].min() > 0.002


def test_torque_noise_is_white_of_the_stated_size_and_the_same_for_every_reader(simulation: Simulation) -> None:
    simulation.step(100)
    errors = []
    for _ in range(500):
        simulation.step()
        a, b = simulation.joint_sensors.read()[2], simulation.joint_sensors.read()[2]
        assert np.array_equal(a, b)
        errors.append(a - simulation.joint_sensors.true_torque)
    spread = np.std(errors, axis=0)
    assert np.allclose(spread[HAND], 0.005, rtol=0.2)
    assert np.allclose(spread[ARM], 0.05, rtol=0.2)
    white = np.mean(np.array(errors)[1:, HAND] * np.array(errors)[:-1, HAND]) / 0.005**2
    assert abs(white) < 0.05


def test_a_frozen_torque_sensor_repeats_its_last_value_until_mended(simulation: Simulation) -> None:
    finger = LAYOUT.finger("right", "fore")
    simulation.step(10)
    simulation.joint_sensors.freeze_torque(finger)
    before = simulation.joint_sensors.read()
    simulation.drives.follow(home_position() + 0.3, LAYOUT.torque, 0.02)
    simulation.step(20)
    after = simulation.joint_sensors.read()
    assert np.array_equal(after[2][finger], before[2][finger])
    assert (after[2][LAYOUT.finger("right", "middle")] != before[2][LAYOUT.finger("right", "middle")]).all()
    assert (after[0][finger][1:] != before[0][finger][1:]).all()
    simulation.joint_sensors.mend_torque(finger)
    simulation.step()
    assert (simulation.joint_sensors.read()[2][finger] != before[2][finger]).any()


def test_sensors_freeze_when_the_scenario_says_so_and_not_before() -> None:
    faults = DisturbanceSection(
        frozen=(FrozenSection(part="right_thumb", from_s=0.05), FrozenSection(part="left_arm_2"))
    )
    simulation = Simulation(Scenario(name="frozen", disturbances=faults).drawn(0))
    thumb, shoulder = LAYOUT.finger("right", "thumb"), LAYOUT.part("left_arm_2")
    seen: list[np.ndarray] = []
    for _ in range(100):
        simulation.step()
        seen.append(simulation.joint_sensors.read()[2].copy())
    changes = np.array(seen[1:]) != np.array(seen[:-1])
    assert not changes[50:, thumb].any() and not changes[:, shoulder].any()
    assert changes[:48, thumb].any(axis=0).all()
    assert changes[:, LAYOUT.finger("right", "fore")].any(axis=0).all()
