"""`preshape hand-bus`: the simulated joint modules as a process of its own, on any CAN interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.exit_codes import ExitCode
from preshape.tools.run_options import MOST_PATIENCE, PATIENCE, ProfileName

if TYPE_CHECKING:
    from preshape.sim_backend.scene_port import ScenePlace

EXAMPLES = (
    ("preshape hand-bus --interface udp_multicast", "MuJoCo behind modules on this machine's buses"),
    ("preshape hand-bus --channel vcan0 --physics simple", "bare joints behind modules on one vcan"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Simulate the joint modules on CAN buses in real time, until Ctrl-C or until a run that was done on them ends.

    In the end it prints the modules' log: each change of state, in their own time, and after what silence.

    Attributes:
        interface: of the buses: socketcan, udp_multicast, or another one of python-can's.
        channel: of the buses, one for each; one socketcan channel alone carries all of them.
        profile: frames of the buses: CAN FD, or classic CAN, which carries less.
        physics: what hangs on the modules: the whole scene (mujoco), or the robot alone in empty space (simple).
        patience_cycles: cycles without a command until a module stops by itself.
        pace: seconds of the modules and the scene in each of the machine's; a run that comes to them goes by it.
        scenario: the scene: a scenario's TOML file, or the name of one that is shipped.
        seed: what the scenario leaves to chance is drawn by this; default: the scenario's own seed.
        overrides: a scenario field to be set; may be given several times.
    """

    interface: str = "socketcan"
    channel: tuple[str, ...] = ()
    profile: ProfileName = "fd"
    physics: Literal["simple", "mujoco"] = "mujoco"
    patience_cycles: int = PATIENCE
    pace: float = 1.0
    scenario: str = "tea_box"
    seed: int | None = None
    overrides: Annotated[
        tuple[str, ...], tyro.conf.arg(name="set", metavar="TABLE.FIELD=VALUE"), tyro.conf.UseAppendAction
    ] = ()

    def __post_init__(self) -> None:
        if self.interface == "virtual":
            raise ConfigurationError("--interface: got virtual, allowed is another, for it reaches no other process")
        if not 1 <= self.patience_cycles <= MOST_PATIENCE:
            raise ConfigurationError(f"--patience-cycles: got {self.patience_cycles}, allowed is 1 .. {MOST_PATIENCE}")
        if not 0.0 < self.pace <= 1.0:
            raise ConfigurationError(f"--pace: got {self.pace:g}, allowed is > 0 and <= 1")
        if self.seed is not None and self.seed < 0:
            raise ConfigurationError(f"--seed: got {self.seed}, allowed is >= 0")


def execute(options: Options) -> int:
    """Serve until it is over."""
    from preshape.sim_backend.bus_joints import BusWiring
    from preshape.sim_backend.hand_bus import serve_robot, serve_scene
    from preshape.tools.can_setup import hand_bus
    from preshape.tools.configuration import load_scenario
    from preshape.tools.end_signals import EndSignals
    from preshape.tools.modules_log_text import modules_log_lines

    topology, addresses = hand_bus(options.profile, options.interface, options.channel)
    wiring = BusWiring(topology, addresses, options.patience_cycles, options.pace)
    scenario = load_scenario(options.scenario, options.overrides)
    seed = scenario.seed if options.seed is None else options.seed
    served = f"{len(topology.modules)} modules on " + ", ".join(dict.fromkeys(map(str, addresses.values())))

    def ready(place: ScenePlace | None = None) -> None:
        behind = "the bare robot" if place is None else f"{scenario.name} with seed {seed}, at {place.folder}"
        print(f"ready: {served}; behind them {behind}", flush=True)

    with EndSignals() as ended:
        if options.physics == "simple":
            log = serve_robot(seed, wiring, ready, ended)
        else:
            log = serve_scene(scenario.drawn(seed), wiring, ready, ended)
    print("\n".join(modules_log_lines(log, topology)), flush=True)
    return ExitCode.DONE
