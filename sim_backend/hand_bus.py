"""Simulated joint modules in real time, as a process of its own: before the whole scene or the bare robot."""

from __future__ import annotations

from collections.abc import Callable

from preshape.hal.kernel_warm_up import warm_up
from preshape.sim_backend.bare_robot import BareRobot
from preshape.sim_backend.bus_joints import BusJoints, BusWiring
from preshape.sim_backend.modules_log import ModulesLog
from preshape.sim_backend.paced_layout import state_record
from preshape.sim_backend.paced_physics import PacedPhysics, run_with_priority, take_priority
from preshape.sim_backend.real_pace import RealPace
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene_port import ScenePlace, ScenePort
from preshape.sim_backend.shared_block import file_bytes
from preshape.sim_backend.simulation import Simulation

Ended = Callable[[], bool]
"""Asked once a step: whether to end."""


def serve_scene(scenario: Scenario, wiring: BusWiring, ready: Callable[[ScenePlace], None], ended: Ended) -> ModulesLog:
    """Simulate a drawn scenario behind modules until a run that has come to it finishes, or until `ended`.

    `ready` is told of the scene's place once everything is up. Returns what the modules did.

    Raises:
        DeviceUnreachable: a bus cannot be opened, or another hand bus serves these buses.
    """
    place = ScenePlace(wiring.addresses)
    place.make()
    simulation = Simulation(scenario)
    joints = BusJoints(simulation, wiring)
    port = ScenePort(place)
    try:
        memory = file_bytes(place.state, state_record(simulation.model), create=True)
        physics = PacedPhysics(simulation, port, memory, wiring.pace)
        simulation.after_step.append(lambda time_ns: physics.end() if ended() else None)
        ready(place)
        run_with_priority(physics, joints)
        return ModulesLog(joints.rack.events, physics.verdict().max_torque_ratio)
    finally:
        joints.close()
        port.close()
        place.door.unlink(missing_ok=True)
        place.state.unlink(missing_ok=True)


def serve_robot(seed: int, wiring: BusWiring, ready: Callable[[], None], ended: Ended) -> ModulesLog:
    """Move the bare robot behind modules until `ended`; return what they did. `DeviceUnreachable`: no such bus."""
    robot = BareRobot(seed)
    joints = BusJoints(robot, wiring)
    try:
        warm_up()
        ready()
        take_priority()
        pace = RealPace(wiring.pace)
        pace.begin(robot.time_ns)
        while not ended():
            robot.step()
            pace.wait(robot.time_ns)
        return ModulesLog(joints.rack.events)
    finally:
        joints.close()
