"""All simulated joint modules of a topology, on their buses and before their plant, whose time drives them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from random import Random

import can

from preshape.hal.can.command_codec import CommandCodec
from preshape.hal.can.identifiers import QUICK_STOP_ID, request_id
from preshape.hal.can.parameter_codec import PARAMETER_LENGTH
from preshape.hal.can.quick_stop_codec import QUICK_STOP_LENGTH
from preshape.hal.can.topology import BusSpec, Topology
from preshape.hal.can.wire import Handler, Wire
from preshape.hal.state import Vector
from preshape.sim_backend.joint_module import JointModule, ModuleEvent
from preshape.sim_backend.plant import Plant


class ModuleRack:
    """Modules that take frames before each step of their plant and send theirs after it.

    `modules` are the modules by node. A module without power neither hears nor speaks.
    """

    def __init__(
        self,
        topology: Topology,
        plant: Plant,
        buses: Mapping[str, can.BusABC],
        seed: int,
        reply_s: float = 0.0,
        delay_steps: int = 0,
    ) -> None:
        """Put modules on open buses (by name) and on a plant's hooks; `seed` draws their keys.

        `delay_steps`: how long modules keep the first command, for senders whose time is not the plant's.
        """
        self._plant = plant
        self._sampled_ns = -1
        self._sample: tuple[Vector, Vector, Vector] = plant.joint_sensors.read()
        self._now_ns = plant.time_ns
        self.modules: dict[int, JointModule] = {}
        for group in topology.groups:
            for module in group.modules:
                random = Random(f"{seed} {module.node}")
                self.modules[module.node] = JointModule(
                    module, group, plant.drives, self._read, random, reply_s, plant.time_ns, delay_steps
                )
        self.wires = {spec.name: self._wire(spec, buses[spec.name]) for spec in topology.buses}
        self._spoken = [
            (self.wires[spec.name], [self.modules[module.node] for module in spec.modules]) for spec in topology.buses
        ]
        plant.before_step.append(self._receive)
        plant.after_step.append(self._send)

    @property
    def events(self) -> list[ModuleEvent]:
        """All modules' changes of state, by time."""
        return sorted((event for module in self.modules.values() for event in module.events), key=_when)

    def power_off(self) -> None:
        """Cut the power of every module."""
        for module in self.modules.values():
            module.power_off()

    def power_on(self) -> None:
        """Give every module its power back."""
        for module in self.modules.values():
            module.power_on(self._plant.time_ns)

    def close(self) -> None:
        """Leave the plant and give the buses back; the joints hold their positions."""
        if self._receive in self._plant.before_step:
            self._plant.before_step.remove(self._receive)
            self._plant.after_step.remove(self._send)
        for module in self.modules.values():
            module.power_off()
        for wire in self.wires.values():
            wire.close()

    def _wire(self, spec: BusSpec, bus: can.BusABC) -> Wire:
        handlers: dict[int, Handler] = {QUICK_STOP_ID: partial(self._quick_stop, spec)}
        lengths = {QUICK_STOP_ID: QUICK_STOP_LENGTH}
        for group in spec.groups:
            codec = CommandCodec(group)
            modules = [self.modules[module.node] for module in group.modules]
            handlers[codec.frame_id] = partial(self._command, codec, modules)
            lengths[codec.frame_id] = codec.length
            for module in modules:
                identifier = request_id(module.module.node)
                handlers[identifier] = partial(self._request, module)
                lengths[identifier] = PARAMETER_LENGTH
        return Wire(bus, spec.profile, handlers, lengths)

    def _receive(self, time_ns: int) -> None:
        self._now_ns = time_ns
        for wire, _ in self._spoken:
            wire.drain()
        for module in self.modules.values():
            module.act(time_ns)

    def _send(self, time_ns: int) -> None:
        now_ns = self._plant.time_ns
        for wire, modules in self._spoken:
            for module in modules:
                if module.powered:
                    for frame_id, payload in module.due(now_ns):
                        wire.send(frame_id, payload)

    def _command(self, codec: CommandCodec, modules: list[JointModule], payload: bytes | bytearray) -> None:
        command = codec.decode(payload)
        for module in modules:
            if module.powered:
                module.receive_command(command, self._now_ns)

    def _request(self, module: JointModule, payload: bytes | bytearray) -> None:
        if module.powered:
            module.receive_request(payload, self._now_ns)

    def _quick_stop(self, spec: BusSpec, payload: bytes | bytearray) -> None:
        for listed in spec.modules:
            module = self.modules[listed.node]
            if module.powered:
                module.receive_quick_stop(self._now_ns)

    def _read(self) -> tuple[Vector, Vector, Vector]:
        """Return the plant's newest sample, read once a step however many modules ask."""
        if self._sampled_ns != self._plant.time_ns:
            self._sample = self._plant.joint_sensors.read()
            self._sampled_ns = self._plant.time_ns
        return self._sample


def _when(event: ModuleEvent) -> tuple[int, int]:
    return event.time_ns, event.node
