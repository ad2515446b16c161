"""One run: build the world, the device, the controller and the loop of a scenario, and gather what came of it."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from preshape.hal.transform import Matrix
from preshape.sim_backend.camera import SceneCamera, box_surface, window_around
from preshape.sim_backend.device import MujocoDevice
from preshape.sim_backend.lockstep import SimClock
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import camera_model
from preshape.sim_backend.sensors import SceneSensors
from preshape.sim_backend.simulation import Simulation
from preshape.sim_backend.texture import face_textures


@dataclass(slots=True, eq=False)
class World:
    """A simulated world and the sensors in it."""

    simulation: Simulation
    sensors: SceneSensors
    device: MujocoDevice
    clock: SimClock


def build_world(scenario: Scenario) -> World:
    """Return the simulation of a drawn scenario with its camera and pose sensor recording."""
    simulation = Simulation(scenario)
    camera = camera_model(scenario)
    size = np.array(scenario.box.size_m)
    eye = SceneCamera(
        simulation.model, box_surface(simulation.model, scenario.box.size_m), face_textures(scenario), scenario.seed
    )

    def cast(X_world_box: Matrix | None) -> np.ndarray:
        mujoco.mj_kinematics(simulation.model, simulation.data)
        window = None if X_world_box is None else window_around(camera, X_world_box, size)
        return eye.cast(simulation.data, camera, window)

    sensors = SceneSensors(scenario, camera, cast)
    simulation.after_step.append(lambda time_ns: sensors.record(time_ns, simulation.X_world_box))
    return World(simulation, sensors, MujocoDevice(simulation), SimClock(simulation))
