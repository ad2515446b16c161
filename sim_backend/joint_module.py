"""The firmware of one simulated joint module: what it obeys, how it stops by itself, and what it says. No bus."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

import numpy as np

from preshape.hal.can.command_codec import SEQUENCES, GroupCommand
from preshape.hal.can.emergency_codec import Emergency, encode_emergency
from preshape.hal.can.heartbeat_codec import HEARTBEAT_S, Heartbeat, encode_heartbeat
from preshape.hal.can.identifiers import emergency_id, heartbeat_id, reply_id, request_id
from preshape.hal.can.inbox import place
from preshape.hal.can.parameter_codec import Reply, Request, decode_request, encode_reply
from preshape.hal.can.state_codec import ModuleReport, StateCodec
from preshape.hal.can.topology import Group, Module
from preshape.hal.can.vocabulary import (
    FIRMWARE_MAJOR,
    READ_ONLY_PARAMETERS,
    REAL_PARAMETERS,
    WHOLE_MODULE,
    Answer,
    ModuleError,
    ModuleState,
    Operation,
    Parameter,
    WireMode,
)
from preshape.hal.layout import LAYOUT
from preshape.hal.state import Vector
from preshape.sim_backend.command_cadence import CommandCadence
from preshape.sim_backend.drives import JointDrives, Joints
from preshape.sim_backend.module_parameters import FIRMWARE_MINOR, ModuleParameters
from preshape.sim_backend.simulation import STEP_NS

ROOM_DEGC, MOST_DEGC = 25.0, 85.0
HEATING_DEGC, HEATING_S = 50.0, 60.0
"""Winding above room temperature after long time at full torque, and its time constant (E)."""
FIRST_COMMAND_NS = 1_000_000_000
"""How long an armed module waits for its first command, ns: whoever armed it may be gone."""

Sample = Callable[[], tuple[Vector, Vector, Vector]]
"""Returns the newest position, velocity and torque of all joints (40,)."""


@dataclass(frozen=True, slots=True)
class ModuleEvent:
    """A change of a module's state, in its own time, and how long after its last command (None: it had none)."""

    time_ns: int
    node: int
    state: ModuleState
    cause: str
    silence_ns: int | None = None


class JointModule:
    """One module in front of its joints' drives and sensors; all times are those of the plant.

    `receive_*` take what frames say, `act` lets the drives do what was commanded, at even distances of time however
    unevenly commands arrive (`CommandCadence`), `due` returns the frames to be sent. `counts` says how many broadcasts
    were `taken`, `repeated`, or refused as `foreign` (another session), `late` (a sequence that is not newer),
    `unarmed` or `damaged`; `events` are its changes of state, in order.

    Before it is armed, after a stop and without power its joints are held where they were measured.
    """

    def __init__(
        self,
        module: Module,
        group: Group,
        drives: JointDrives,
        sample: Sample,
        random: Random,
        reply_s: float = 0.0,
        now_ns: int = 0,
        delay_steps: int = 0,
    ) -> None:
        """Switch on; `random` gives the arming keys, a state is sent `reply_s` after the broadcast it answers.

        `delay_steps`: how long the first command waits, so that those after it may be as late.
        """
        self.module = module
        self.state, self.error = ModuleState.DISARMED, ModuleError.NONE
        self.counts: Counter[str] = Counter()
        self.events: list[ModuleEvent] = []
        self._codec = StateCodec(module, group)
        offset = group.offset(module)
        self._own = slice(offset, offset + len(module.joints))
        self._indices = np.array(module.indices, dtype=np.int64)
        self._joints: Joints = place(module.indices)
        self._drives, self._sample, self._random = drives, sample, random
        self._reply_ns, self._delay_steps = round(reply_s * 1e9), delay_steps
        self.parameters = ModuleParameters(module, drives, self._joints)
        self.powered = True
        self._boots = self._beats = self._emergencies = 0
        self._temperature_degc, self._warmed_ns = ROOM_DEGC, now_ns
        self._outgoing: list[tuple[int, bytearray]] = []
        self._start(now_ns)

    # Power.

    def power_off(self) -> None:
        """Go dark in the middle of whatever it does: the brakes close, nothing is said any more."""
        self.powered, self._waiting = False, None
        self._outgoing.clear()
        self._hold()

    def power_on(self, now_ns: int) -> None:
        """Start anew: disarmed, with no memory of any session."""
        self.powered = True
        self._start(now_ns)

    def _start(self, now_ns: int) -> None:
        self._boots += 1
        self._key = self._random.getrandbits(32)
        self._session = 0
        self._sequence: int | None = None
        self._answer: tuple[int, int, bool] | None = None
        self._last_answered: tuple[int, int] | None = None
        self._mode: WireMode | None = None
        self._waiting: GroupCommand | None = None
        self._commanded_ns: int | None = None
        self._beat_ns = now_ns
        self._enter(now_ns, ModuleState.DISARMED, ModuleError.NONE, "power on")

    # What comes in.

    def receive_command(self, command: GroupCommand | None, now_ns: int) -> None:
        """Take a broadcast of its group, None for a damaged one; whatever becomes of it, it is a request to report."""
        if command is None:
            self.counts["damaged"] += 1
            return
        answered = command.session, command.sequence
        if answered == self._last_answered:
            self.counts["repeated"] += 1
            return
        self._last_answered = answered
        taken = command.mode is not WireMode.POLL and self._take(command, now_ns)
        self._answer = now_ns + self._reply_ns, command.sequence, taken

    def receive_quick_stop(self, now_ns: int) -> None:
        """Stop, whatever the state; no order to arm that was given before is good any more."""
        self._key = self._random.getrandbits(32)
        if self.state in (ModuleState.ARMED, ModuleState.DISARMED):
            self._enter(now_ns, ModuleState.STOPPED, self.error, "quick stop")

    def receive_request(self, payload: bytes | bytearray, now_ns: int) -> None:
        """Read or write a parameter, and answer."""
        node = self.module.node
        request = decode_request(request_id(node), payload)
        if request is None:
            self.counts["damaged"] += 1
            return
        answer, value = self._serve(request, now_ns)
        reply = Reply(answer, request.parameter, request.tag, request.joint, value, self._key)
        self._outgoing.append((reply_id(node), encode_reply(reply_id(node), reply)))

    def act(self, now_ns: int) -> None:
        """Execute the newest command if one waits and it is time; call it once a step."""
        waiting = self._waiting
        if waiting is not None and self._cadence.takes(now_ns // STEP_NS, waiting=True):
            self._execute(waiting)
            self._mode, self._waiting = waiting.mode, None

    # What goes out.

    def due(self, now_ns: int) -> list[tuple[int, bytearray]]:
        """Let time pass until now; return the frames to be sent: identifier and payload."""
        self._watch(now_ns)
        self._warm(now_ns)
        if now_ns >= self._beat_ns:
            self._beat(now_ns)
        if self._answer is not None and now_ns >= self._answer[0]:
            self._outgoing.append((self._codec.frame_id, self._codec.encode(self._report(*self._answer[1:]))))
            self._answer = None
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def fail(self, now_ns: int, error: ModuleError, joint: int = WHOLE_MODULE) -> None:
        """Go to FAULT because something in the module is broken, and say so at once."""
        self._enter(now_ns, ModuleState.FAULT, error, error.name.lower())
        self._emergencies = (self._emergencies + 1) % 256
        emergency = Emergency(self.state, error, self.module.node, joint, self._emergencies)
        self._outgoing.append((emergency_id(self.module.node), encode_emergency(emergency)))

    # Inside.

    def _take(self, command: GroupCommand, now_ns: int) -> bool:
        """Let a command wait to be executed if it is of this session and newer than the last; return whether it is."""
        refusal = self._refusal(command)
        if refusal:
            self.counts[refusal] += 1
            return False
        self._sequence, self._commanded_ns = command.sequence, now_ns
        self.counts["taken"] += 1
        self._waiting = command
        return True

    def _refusal(self, command: GroupCommand) -> str:
        if self.state is not ModuleState.ARMED:
            return "unarmed"
        if command.session != self._session:
            return "foreign"
        newer = 1 if self._sequence is None else (command.sequence - self._sequence) % SEQUENCES
        return "" if 0 < newer < SEQUENCES // 2 else "late"

    def _execute(self, command: GroupCommand) -> None:
        own, parameters, drives = self._own, self.parameters, self._drives
        enabled, joints = self._enabled(command.enable >> own.start)
        limit = np.minimum(command.torque_limit[own], parameters.torque_limit)[enabled]
        target = command.target[own]
        match command.mode:
            case WireMode.POSITION:
                within = np.minimum(np.maximum(target, parameters.lower), parameters.upper)[enabled]
                drives.follow(within, limit, parameters.cycle_us * 1e-6, joints)
            case WireMode.TORQUE:
                drives.push(target[enabled], limit, joints)
            case WireMode.HOLD | WireMode.BRAKE:
                if self._mode is not command.mode:
                    self._held = self._sample()[0][self._joints].copy()
                strength = limit if command.mode is WireMode.HOLD else LAYOUT.torque[joints]
                drives.hold(self._held[enabled], strength, joints)
            case WireMode.DISABLED:
                drives.release(joints)
            case WireMode.POLL:
                return

    def _enabled(self, mask: int) -> tuple[Joints, Joints]:
        """Return where the enabled joints stand among the module's own, and in the layout."""
        count = len(self._indices)
        if mask & ((1 << count) - 1) == (1 << count) - 1:
            return slice(None), self._joints
        enabled = np.array([k for k in range(count) if mask >> k & 1], dtype=np.int64)
        return enabled, self._indices[enabled]

    def _serve(self, request: Request, now_ns: int) -> tuple[Answer, float]:
        parameter = request.parameter
        if parameter in REAL_PARAMETERS and request.joint >= len(self._indices):
            return Answer.UNKNOWN_JOINT, 0.0
        answer = Answer.DONE
        if request.operation is Operation.WRITE:
            answer = self._set(request, now_ns)
        return answer, self._value(parameter, request.joint)

    def _set(self, request: Request, now_ns: int) -> Answer:
        parameter = request.parameter
        if parameter in READ_ONLY_PARAMETERS:
            return Answer.READ_ONLY
        if parameter is Parameter.SESSION:
            return self._arm(int(request.value), request.key, now_ns)
        if self.state is ModuleState.ARMED:
            return Answer.NOT_NOW
        if parameter in REAL_PARAMETERS:
            return self.parameters.set_real(parameter, request.joint, request.value)
        return self.parameters.set_whole(parameter, int(request.value))

    def _value(self, parameter: Parameter, joint: int) -> float:
        if parameter in REAL_PARAMETERS:
            return self.parameters.real(parameter, joint)
        if parameter is Parameter.KEY:
            return self._key
        return self._session if parameter is Parameter.SESSION else self.parameters.whole(parameter)

    def _arm(self, session: int, key: int, now_ns: int) -> Answer:
        if key != self._key:
            return Answer.WRONG_KEY
        if session == 0:
            return Answer.OUT_OF_RANGE
        if self._temperature_degc > MOST_DEGC:
            return Answer.NOT_NOW
        if self.state is not ModuleState.ARMED or session != self._session:
            self._session, self._sequence, self._commanded_ns, self._mode = session, None, None, None
            self._enter(now_ns, ModuleState.ARMED, ModuleError.NONE, f"armed for session {session:#010x}")
        return Answer.DONE

    def _enter(self, now_ns: int, state: ModuleState, error: ModuleError, cause: str) -> None:
        """Change the state and hold the measured position as strongly as allowed until the next command."""
        if state is not ModuleState.ARMED:
            if self.state is ModuleState.ARMED:
                self._key = self._random.getrandbits(32)
            self._session = 0
        silence_ns = None if self._commanded_ns is None else now_ns - self._commanded_ns
        self.state, self.error, self._entered_ns = state, error, now_ns
        self._mode = self._commanded_ns = self._waiting = None
        self._cadence = CommandCadence(max(1, round(self.parameters.cycle_us * 1000 / STEP_NS)), self._delay_steps)
        self._hold()
        self.events.append(ModuleEvent(now_ns, self.module.node, state, cause, silence_ns))

    def _hold(self) -> None:
        self._held = self._sample()[0][self._joints].copy()
        self._drives.hold(self._held, self.parameters.torque_limit, self._joints)

    def _watch(self, now_ns: int) -> None:
        if self.state is not ModuleState.ARMED:
            return
        since_ns, patience_ns = self._commanded_ns, self.parameters.watchdog_ns
        if since_ns is None:
            since_ns, patience_ns = self._entered_ns, FIRST_COMMAND_NS
        if now_ns - since_ns > patience_ns:
            self.fail(now_ns, ModuleError.WATCHDOG)

    def _warm(self, now_ns: int) -> None:
        """Follow the winding's temperature: T' = (T_room + 50 K (tau / tau_max)^2 - T) / 60 s, the hottest joint."""
        elapsed_s = (now_ns - self._warmed_ns) * 1e-9
        if elapsed_s < HEARTBEAT_S:
            return
        self._warmed_ns = now_ns
        load = float(np.max(np.abs(self._sample()[2][self._joints] / LAYOUT.torque[self._joints])))
        end_degc = ROOM_DEGC + HEATING_DEGC * load * load
        self._temperature_degc += (end_degc - self._temperature_degc) * min(1.0, elapsed_s / HEATING_S)
        if self._temperature_degc > MOST_DEGC and self.state is not ModuleState.FAULT:
            self.fail(now_ns, ModuleError.OVER_TEMPERATURE)

    def _beat(self, now_ns: int) -> None:
        self._beats = (self._beats + 1) % 256
        self._beat_ns = max(self._beat_ns + round(HEARTBEAT_S * 1e9), now_ns)
        versions = FIRMWARE_MAJOR, FIRMWARE_MINOR
        serial = self.parameters.serial
        beat = Heartbeat(self.state, self.error, self._beats, *versions, self._boots, serial, self._key)
        self._outgoing.append((heartbeat_id(self.module.node), encode_heartbeat(self.module.node, beat)))

    def _report(self, sequence: int, taken: bool) -> ModuleReport:
        position, velocity, torque = self._sample()
        joints, temperature = self._joints, round(self._temperature_degc)
        measured = position[joints], velocity[joints], torque[joints] + self.parameters.torque_offset
        return ModuleReport(sequence, self.state, self.error, taken, temperature, *measured)
