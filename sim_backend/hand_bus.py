"""Simulated joint modules in real time, as a process of its own: before the whole scene or the bare robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from preshape.hal.kernel_warm_up import warm_up
from preshape.sim_backend.bare_robot import BareRobot
from preshape.sim_backend.bus_joints import BusJoints, BusWiring
from preshape.sim_backend.joint_module import ModuleEvent
from preshape.sim_backend.paced_layout import state_record
from preshape.sim_backend.paced_physics import PacedPhysics, run_with_priority, take_priority
from preshape.sim_backend.real_pace import RealPace
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene_port import ScenePlace, ScenePort
from preshape.sim_backend.shared_block import file_bytes
from preshape.sim_backend.simulation import Simulation

Ended = Callable[[], bool]
"""Asked once a step: whether to end."""


@dataclass(frozen=True, slots=True)
class BusLog:
    """What the modules did: their changes of state by time, and the largest share of a torque limit in physics.

    The share is what lasted for 10 ms, as the referee takes it; None where there is no referee.
    """

    events: list[ModuleEvent]
    max_torque_ratio: float | None = None


def serve_scene(scenario: Scenario, wiring: BusWiring, ready: Callable[[ScenePlace], None], ended: Ended) -> BusLog:
    """Simulate a drawn scenario behind modules until a run that has come to it finishes, or until `ended`.

    `ready` is told of the scene's place once everything is up.

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
        return BusLog(joints.rack.events, physics.verdict().max_torque_ratio)
    finally:
        joints.close()
        port.close()
        place.door.unlink(missing_ok=True)
        place.state.unlink(missing_ok=True)


def serve_robot(seed: int, wiring: BusWiring, ready: Callable[[], None], ended: Ended) -> BusLog:
    """Move the bare robot behind modules until `ended`; `DeviceUnreachable` if a bus cannot be opened."""
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
        return BusLog(joints.rack.events)
    finally:
        joints.close()
