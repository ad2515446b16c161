"""`preshape serve`: hold a device, and the world around it, for a controller in another process."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.exit_codes import ExitCode
from preshape.tools.remote_options import RemoteOptions
from preshape.tools.run_options import MESSAGES_RATE_HZ, ProfileName, RunOptions

EXAMPLES = (
    ("preshape serve", "MuJoCo, for a `preshape run --device zenoh` elsewhere"),
    ("preshape serve --device can --seed 7", "joint modules on buses, with MuJoCo behind them"),
)
"""Shown by `--help`: what to paste, and what it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options(RemoteOptions):
    """Serve a simulated device with its camera and referee over Zenoh, for `preshape run --device zenoh`.

    Ends when a run has been finished, or by Ctrl-C or SIGTERM, with the device stopped; until then one client after the
    other may open the device. A client that goes away without a word leaves the joints stopped where they are.

    Attributes:
        device: what is served, in real time: MuJoCo, or joint modules on CAN buses with MuJoCo behind them.
        rate_hz: states a second, and commands a second that the joints expect.
        interface, channel, profile: of the buses, as of `preshape run`.
        patience_cycles: cycles without a command until the joints stop by themselves; 0: 25.
        scenario: a scenario's TOML file, or the name of one that is shipped; the run must name the same.
        seed: what the scenario leaves to chance is drawn by this; default: the scenario's own seed.
        overrides: a scenario field to be set; may be given several times.
    """

    device: Literal["mujoco", "can"] = "mujoco"
    rate_hz: int = MESSAGES_RATE_HZ
    interface: str = ""
    channel: tuple[str, ...] = ()
    profile: ProfileName = "fd"
    patience_cycles: int = 0
    scenario: str = "tea_box"
    seed: int | None = None
    overrides: Annotated[
        tuple[str, ...], tyro.conf.arg(name="set", metavar="TABLE.FIELD=VALUE"), tyro.conf.UseAppendAction
    ] = ()

    def __post_init__(self) -> None:
        if self.seed is not None and self.seed < 0:
            raise ConfigurationError(f"--seed: got {self.seed}, allowed is >= 0")
        _ = self.run

    @property
    def run(self) -> RunOptions:
        """The run whose world is served."""
        return RunOptions(
            device=self.device,
            paced=True,
            rate_hz=self.rate_hz,
            interface=self.interface,
            channel=self.channel,
            profile=self.profile,
            patience_cycles=self.patience_cycles,
        )


def execute(options: Options) -> int:
    """Serve until a run has been finished, or a signal asks for the end."""
    from preshape.hal.remote_calls import DEVICE_KEY
    from preshape.tools.configuration import load_scenario
    from preshape.tools.device_server import DeviceServer
    from preshape.tools.end_signals import EndSignals
    from preshape.tools.real_time import real_time
    from preshape.tools.remote_world import described
    from preshape.tools.run_world import open_world
    from preshape.tools.telemetry_keys import Keys
    from preshape.tools.zenoh_session import open_session, robot_settings

    scenario = load_scenario(options.scenario, options.overrides)
    drawn = scenario.drawn(scenario.seed if options.seed is None else options.seed)
    root = Keys(options.robot).of(DEVICE_KEY)
    spoken = [f"{root}/{tail}" for tail in ("state", "perception", "scene", "alive", "call/**")]
    with (
        EndSignals() as ended,
        open_world(drawn, options.run) as world,
        # What Zenoh starts inherits the priority; the world's processes have their own.
        real_time(),
        open_session(robot_settings(options.endpoint, spoken), options.zenoh_config) as session,
    ):
        server = DeviceServer(session, root, world, described(drawn, options.rate_hz), float(options.rate_hz), _say)
        _say(f"serving {drawn.name}, seed {drawn.seed}, as {root} at {options.zenoh_config or options.endpoint}")
        server.run(ended)
        if ended() and not server.finished:
            _say("interrupted: the device has been stopped")
            ratio = world.finish().verdict.max_torque_ratio
            _say(f"largest torque in physics: {ratio:.2f} of its limit")
        for reason, count in sorted(server.refused.items()):
            _say(f"refused, {reason}: {count}")
    return ExitCode.DONE


def _say(text: str) -> None:
    print(f"preshape serve: {text}", file=sys.stderr, flush=True)
