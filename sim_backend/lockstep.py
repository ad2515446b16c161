"""Physics and controller in one process, in turns: deterministic, as fast as the machine goes."""

from __future__ import annotations

from dataclasses import dataclass

from preshape.hal.device import Device
from preshape.hal.state import Vector
from preshape.sim_backend.device import COMMAND_PERIOD_S, MujocoDevice
from preshape.sim_backend.kicks import KickSchedule
from preshape.sim_backend.plant import Plant
from preshape.sim_backend.referee import Referee
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene_perception import attach_sensors
from preshape.sim_backend.sensors import SceneSensors
from preshape.sim_backend.simulation import STEP_NS, Simulation


class SimClock:
    """`preshape.hal.clock.Clock` that is the simulation: waiting steps it."""

    def __init__(self, simulation: Plant) -> None:
        """Read and advance a simulation's time."""
        self._simulation = simulation

    def now_ns(self) -> int:
        """Return the simulated time."""
        return self._simulation.time_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Step the simulation to the first step at or after the deadline."""
        remaining = deadline_ns - self._simulation.time_ns
        if remaining > 0:
            self._simulation.step(-(-remaining // STEP_NS))


@dataclass(frozen=True, slots=True, eq=False)
class LockstepWorld:
    """Everything around one lockstep run; only `device`, `clock` and `perception` are the controller's."""

    simulation: Simulation
    device: Device
    clock: SimClock
    perception: SceneSensors
    referee: Referee
    kicks: KickSchedule


def open_lockstep(scenario: Scenario, home: Vector | None = None, period_s: float = COMMAND_PERIOD_S) -> LockstepWorld:
    """Return the world of a drawn scenario at time 0, watched by the referee from the first step on.

    `period_s` is the time between two commands.
    """
    simulation = Simulation(scenario, home=home)
    referee = Referee(simulation)
    return LockstepWorld(
        simulation,
        MujocoDevice(simulation, period_s),
        SimClock(simulation),
        attach_sensors(simulation),
        referee,
        KickSchedule(simulation, referee),
    )
