"""The controller knows nothing but its inputs: what it can reach holds no truth, and nonsense there changes nothing."""

from __future__ import annotations

import functools
import time
import types
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import pytest

from preshape.control.box_opening import BoxOpening
from preshape.control.controller import Setpoint
from preshape.control.loop import ControlLoop
from preshape.control.loop_result import LoopConfig
from preshape.control.observer import Observers
from preshape.hal.gate import SafetyGate
from preshape.hal.layout import LAYOUT
from preshape.hal.state import RobotState, Vector
from preshape.hal.tick_record import TickRecord
from preshape.hal.world import Image, OrientedBox, PoseSample
from preshape.sim_backend.lockstep import LockstepWorld, open_lockstep
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import nominal_box, workcell
from preshape.sim_backend.sensors import SceneSensors
from preshape.sim_backend.texture import texture_library
from preshape.tools.configuration import load_scenario

RATE_HZ = 500.0
SECONDS = 10.0
NONSENSE = 1234.5
TRUTH = ("preshape.sim_backend", "mujoco")


def open_seed(seed: int) -> tuple[Scenario, LockstepWorld, BoxOpening]:
    """Return a drawn scenario, its world and a controller in it with the inputs of a run."""
    # A copy of its own: sections left at their defaults are shared by all scenarios of a process.
    drawn = msgspec.convert(msgspec.to_builtins(load_scenario("tea_box").drawn(seed)), Scenario)
    world = open_lockstep(drawn)
    world.device.open()
    box = drawn.opening
    library = texture_library(box.tab_length_m, box.tab_depth_m)

    def report(opening: Any, X_world_box: Any) -> None:
        world.referee.report_opening(opening.face, opening.edge, opening.offset, X_world_box)

    controller = BoxOpening(
        workcell(drawn), nominal_box(drawn), library, world.perception, 1.0 / RATE_HZ, report_opening=report
    )
    return drawn, world, controller


@dataclass(slots=True)
class Script:
    """All that a controller was told in a run, in order, and what it answered."""

    calls: list[tuple[Any, ...]] = field(default_factory=list)
    setpoints: list[Setpoint] = field(default_factory=list)
    poses: list[tuple[int, PoseSample | None]] = field(default_factory=list)
    obstacles: list[tuple[int, tuple[OrientedBox, ...]]] = field(default_factory=list)
    images: list[tuple[int, Image]] = field(default_factory=list)


class Recorded:
    """A controller whose inputs and setpoints are written into a script."""

    def __init__(self, controller: BoxOpening, script: Script) -> None:
        self._controller, self._script = controller, script

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        self._script.calls.append(("step", tick, now_ns, state))
        setpoint = self._controller.step(tick, now_ns, state)
        self._script.setpoints.append(Setpoint(setpoint.position.copy(), setpoint.torque_limit.copy()))
        return setpoint

    def follow(self, position: Vector, velocity: Vector) -> None:
        self._script.calls.append(("follow", position.copy(), velocity.copy()))
        self._controller.follow(position, velocity)

    def note(self, record: TickRecord) -> None:
        self._controller.note(record)


def record_sensors(sensors: SceneSensors, script: Script) -> None:
    """Keep every answer of the sensors."""
    pose, obstacles, image = sensors.object_pose, sensors.obstacles, sensors.image

    def kept(answers: list[Any], ask: Any) -> Any:
        def asked(now_ns: int) -> Any:
            answer = ask(now_ns)
            answers.append((now_ns, answer))
            return answer

        return asked

    vars(sensors)["object_pose"] = kept(script.poses, pose)
    vars(sensors)["obstacles"] = kept(script.obstacles, obstacles)
    vars(sensors)["image"] = kept(script.images, image)


def replay_sensors(sensors: SceneSensors, script: Script) -> None:
    """Let the sensors give the script's answers, each to the question that it was given to."""

    def given(answers: list[Any]) -> Any:
        left = iter(answers)

        def asked(now_ns: int) -> Any:
            when, answer = next(left)
            assert when == now_ns
            return answer

        return asked

    vars(sensors)["object_pose"] = given(script.poses)
    vars(sensors)["obstacles"] = given(script.obstacles)
    vars(sensors)["image"] = given(script.images)


def run_recorded(seed: int) -> Script:
    """Run a controller on the simulated robot and return what passed between them."""
    _, world, controller = open_seed(seed)
    script = Script()
    record_sensors(world.perception, script)
    config = LoopConfig(rate_hz=RATE_HZ, max_ticks=round(SECONDS * RATE_HZ))
    loop = ControlLoop(world.device, world.clock, SafetyGate(), Observers(()), time.perf_counter_ns, config)
    loop.run(Recorded(controller, script))
    return script


def poison(value: Any) -> Any:
    """Return nonsense of the same shape and type."""
    if isinstance(value, msgspec.Struct):
        for name in value.__struct_fields__:
            msgspec.structs.force_setattr(value, name, poison(getattr(value, name)))
        return value
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 7
    if isinstance(value, float):
        return NONSENSE
    if isinstance(value, str):
        return "nonsense"
    return tuple(poison(item) for item in value) if isinstance(value, tuple) else value


def poison_physics(world: LockstepWorld) -> int:
    """Fill every floating-point array of the simulated scene with nonsense; return how many numbers that were."""
    count = 0
    for owner in (world.simulation.model, world.simulation.data):
        for name in dir(owner):
            values = getattr(owner, name, None) if not name.startswith("_") else None
            if isinstance(values, np.ndarray) and values.dtype == np.float64 and values.flags.writeable:
                values[...] = NONSENSE
                count += values.size
    return count


def children(value: Any) -> Iterator[tuple[str, Any]]:
    """Give everything that an object leads to in one step, with how."""
    if isinstance(value, dict):
        yield from ((f"[{key!r}]", item) for key, item in value.items())
    elif isinstance(value, (list, tuple, set, frozenset)):
        yield from ((f"[{number}]", item) for number, item in enumerate(value))
    elif isinstance(value, types.GeneratorType):
        if value.gi_frame is not None:
            yield from ((f".{name}", item) for name, item in value.gi_frame.f_locals.items())
        if value.gi_yieldfrom is not None:
            yield ".yieldfrom", value.gi_yieldfrom
    elif isinstance(value, types.MethodType):
        yield ".__self__", value.__self__
    elif isinstance(value, types.FunctionType):
        cells = [(f".{n}", c) for n, c in zip(value.__code__.co_freevars, value.__closure__ or (), strict=True)]
        yield from ((name, cell.cell_contents) for name, cell in cells)
        yield ".__defaults__", value.__defaults__
    elif isinstance(value, functools.partial):
        yield from ((".func", value.func), (".args", value.args), (".keywords", value.keywords))
    else:
        yield from ((f".{name}", item) for name, item in getattr(value, "__dict__", {}).items())
        for owner in type(value).__mro__:
            slots = getattr(owner, "__slots__", ())
            for name in (slots,) if isinstance(slots, str) else slots:
                if hasattr(value, name):
                    yield f".{name}", getattr(value, name)


def truths(root: Any, gates: tuple[Any, ...]) -> tuple[dict[str, type], int]:
    """Return path and type of anything of the simulator that an object leads to, and the count of objects seen.

    Nothing is looked for behind a gate.
    """
    found: dict[str, type] = {}
    seen: dict[int, Any] = {id(gate): gate for gate in gates}
    queue: list[tuple[str, Any]] = [("", root)]
    while queue:
        path, value = queue.pop()
        if id(value) in seen:
            continue
        seen[id(value)] = value
        if isinstance(value, (type, types.ModuleType, str, bytes, int, float, np.ndarray)) or value is None:
            continue
        if type(value).__module__.startswith(TRUTH):
            found[path] = type(value)
            continue
        queue += [(path + step, child) for step, child in children(value)]
    return found, len(seen)


def gates_of(controller: BoxOpening, world: LockstepWorld) -> tuple[Any, ...]:
    """Return where a controller touches the simulator at all: the sensors it asks, the callable it tells its find."""
    return world.perception, controller._report_opening  # pyright: ignore[reportPrivateUsage]


def test_nothing_of_the_simulator_is_reachable_but_the_sensors_and_the_report() -> None:
    _, world, controller = open_seed(0)
    for tick in range(50):
        now_ns = world.clock.now_ns()
        state = world.device.read(now_ns)
        if tick == 0:
            controller.follow(state.position, np.zeros(LAYOUT.dof))
        controller.step(tick, now_ns, state)
        world.clock.sleep_until_ns(now_ns + round(1e9 / RATE_HZ))
    found, seen = truths(controller, gates_of(controller, world))
    assert found == {}
    assert seen > 100
    through_gates, _ = truths(controller, ())
    assert set(through_gates.values()) == {SceneSensors, LockstepWorld}


def test_the_sensors_show_nothing_in_public_but_what_they_sense() -> None:
    _, world, _ = open_seed(0)
    public = {name for name in dir(world.perception) if not name.startswith("_")}
    assert public == {"record", "object_pose", "obstacles", "image"}
    true_pose = world.simulation.X_world_box
    for _ in range(100):
        world.clock.sleep_until_ns(world.clock.now_ns() + 2_000_000)
    sample = world.perception.object_pose(world.clock.now_ns())
    assert sample is not None and np.abs(sample.X_world_box - true_pose).max() > 1e-5
    answered = {f for kind in (PoseSample, Image, OrientedBox) for f in kind.__dataclass_fields__}
    assert not answered & {"mass", "friction", "offset", "face", "edge", "strengths", "scenario"}


@pytest.mark.parametrize("hide", ["attribute", "list", "closure", "method", "physics", "generator"])
def test_the_search_finds_truth_wherever_it_is_hidden(hide: str) -> None:
    drawn, world, controller = open_seed(0)

    def held(truth: Any) -> Iterator[None]:
        yield
        assert truth

    holder = held(drawn)
    next(holder)
    hidden = {
        "attribute": drawn,
        "list": [{"x": (drawn,)}],
        "closure": lambda: drawn,
        "method": world.simulation.step,
        "physics": world.simulation.model,
        "generator": holder,
    }[hide]
    controller.work.notes.append(hidden)  # type: ignore[arg-type]
    found, _ = truths(controller, gates_of(controller, world))
    assert [path.startswith(".work.notes") for path in found] == [True]


@pytest.mark.physics
@pytest.mark.slow
def test_the_same_inputs_give_the_same_commands_when_all_truth_is_nonsense() -> None:
    script = run_recorded(3)
    assert len(script.setpoints) == round(SECONDS * RATE_HZ)
    drawn, world, controller = open_seed(3)
    poison(drawn)
    assert drawn.box.mass_kg == drawn.box.friction == drawn.opening.offset_m == drawn.strengths.scale == NONSENSE
    assert drawn.opening.face == "nonsense"
    assert poison_physics(world) > 10_000
    replay_sensors(world.perception, script)
    again: list[Setpoint] = []
    for name, *arguments in script.calls:
        answer = getattr(controller, name)(*arguments)
        if name == "step":
            again.append(answer)
    moved = np.ptp([setpoint.position for setpoint in script.setpoints], axis=0)
    assert moved.max() > 0.3
    for first, second in zip(script.setpoints, again, strict=True):
        np.testing.assert_array_equal(first.position, second.position)
        np.testing.assert_array_equal(first.torque_limit, second.torque_limit)
