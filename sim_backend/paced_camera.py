"""The camera process of a paced run: casts an image of the newest published scene whenever it is asked for one."""

from __future__ import annotations

import ctypes
import os
import signal
from multiprocessing.connection import Connection
from pathlib import Path

import mujoco
import numpy as np

from preshape.hal.transform import Matrix
from preshape.sim_backend.paced_layout import state_record
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene_perception import image_cast
from preshape.sim_backend.shared_block import SharedBlock, file_bytes
from preshape.sim_backend.simulation import Simulation

NICENESS = 5


def run_camera(
    scenario: Scenario,
    requests: Connection,
    state_memory: ctypes.Array[ctypes.c_char] | Path,
    pixels: ctypes.Array[ctypes.c_char],
) -> None:
    """Answer each request (expected X_world_box or None) with when the image was taken, until None comes alone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICENESS)
    simulation = Simulation(scenario)
    cast = image_cast(simulation)
    record = state_record(simulation.model)
    memory = file_bytes(state_memory, record) if isinstance(state_memory, Path) else state_memory
    state = SharedBlock(memory, record)
    out = np.frombuffer(memoryview(pixels), np.uint8)
    requests.send("ready")
    while True:
        try:
            request: tuple[Matrix | None] | None = requests.recv()
        except EOFError:
            return
        if request is None:
            return
        taken_ns = _load(simulation, state)
        if taken_ns:
            out[:] = cast(request[0]).ravel()
        requests.send(taken_ns)


def _load(simulation: Simulation, state: SharedBlock) -> int:
    """Put the newest published scene into a model of one's own; return its time in ns, 0 if none could be read."""
    record = state.read()
    if record is None:
        return 0
    data = simulation.data
    data.qpos[:] = record[0]["qpos"]
    data.mocap_pos[:] = record[0]["mocap_pos"][: simulation.model.nmocap]
    mujoco.mj_kinematics(simulation.model, data)
    return int(record[0]["now_ns"])
