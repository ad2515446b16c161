"""The scene's sensors on a running simulation: its box pose sampled at its rate, its camera looking at it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.transform import Matrix
from preshape.sim_backend.camera import SceneCamera, box_surface, window_around
from preshape.sim_backend.scene import camera_model
from preshape.sim_backend.sensors import Cast, SceneSensors
from preshape.sim_backend.simulation import Simulation
from preshape.sim_backend.texture import face_textures


def attach_sensors(simulation: Simulation, cast: Cast | None = None) -> SceneSensors:
    """Return the sensors of a simulation, recording from now on; `cast` takes the images (default: `image_cast`)."""
    scenario = simulation.scenario
    cast = cast or image_cast(simulation)
    appeared_s = simulation.obstacles.appeared_s
    sensors = SceneSensors(scenario, camera_model(scenario), cast, appeared_s, simulation.start_ns)
    period_ns = round(1e9 / scenario.perception.rate_hz)
    due_ns = simulation.start_ns

    def record(time_ns: int) -> None:
        nonlocal due_ns
        if time_ns >= due_ns:
            due_ns += period_ns
            sensors.record(time_ns, simulation.X_world_box)

    simulation.after_step.append(record)
    return sensors


def image_cast(simulation: Simulation) -> Cast:
    """Return what takes an image of the simulation's scene at the moment it is called."""
    scenario, model = simulation.scenario, simulation.model
    size = np.array(scenario.box.size_m)
    camera = SceneCamera(model, box_surface(model, size), face_textures(scenario), scenario.seed)
    lens = camera_model(scenario)

    def cast(X_world_box: Matrix | None) -> NDArray[np.uint8]:
        window = None if X_world_box is None else window_around(lens, X_world_box, size)
        return camera.cast(simulation.data, lens, window)

    return cast
