"""The DBC files of a topology as text. `python -m preshape.hal.can.dbc` writes the shipped ones anew."""

from __future__ import annotations

from pathlib import Path

from preshape.hal.can.dbc_message import HOST_NAME, Message, Signal, messages
from preshape.hal.can.dbc_slices import sliced
from preshape.hal.can.topology import TOPOLOGY, Profile, Topology

DBC_FILE = Path(__file__).with_name("hand_bus.dbc")
CLASSIC_DBC_FILE = Path(__file__).with_name("hand_bus_classic.dbc")
"""The shipped files: the default topology's frames, with FD and in classic slices."""

CLASSIC_FRAME, FD_FRAME = 0, 14
"""Numbers of StandardCAN and StandardCAN_FD among the values of the attribute VFrameFormat."""
_FORMATS = ("StandardCAN", "ExtendedCAN", *(f"reserved{number}" for number in range(2, FD_FRAME)), "StandardCAN_FD")


def dbc_text(topology: Topology = TOPOLOGY, profile: Profile = "fd") -> str:
    """Return the DBC file that names every frame of a topology whose buses have a profile."""
    frames = messages(topology)
    number, bus_type = FD_FRAME, "CAN FD"
    if profile == "classic":
        frames = tuple(map(sliced, frames))
        number, bus_type = CLASSIC_FRAME, "CAN"
    nodes = [HOST_NAME, *(module.name for module in topology.modules)]
    formats = ",".join(f'"{name}"' for name in _FORMATS)
    blocks = [
        'VERSION ""\n',
        "NS_ :\n\nBS_:\n",
        f"BU_: {' '.join(nodes)}\n",
        *(_message(frame) for frame in frames),
        f'BA_DEF_ BO_ "VFrameFormat" ENUM {formats};',
        'BA_DEF_ "BusType" STRING ;',
        f'BA_DEF_DEF_ "VFrameFormat" "{_FORMATS[number]}";',
        f'BA_DEF_DEF_ "BusType" "{bus_type}";',
        f'BA_ "BusType" "{bus_type}";',
        *(f'BA_ "VFrameFormat" BO_ {frame.frame_id} {number};' for frame in frames),
        *(_choices(frame, signal) for frame in frames for signal in frame.signals if signal.choices),
        *(f"SIG_VALTYPE_ {frame.frame_id} {s.name} : 1;" for frame in frames for s in frame.signals if s.real),
    ]
    return "\n".join(blocks) + "\n"


def _message(frame: Message) -> str:
    lines = [f"BO_ {frame.frame_id} {frame.name}: {frame.length} {frame.sender}"]
    return "\n".join([*lines, *(_signal(frame, signal) for signal in frame.signals)]) + "\n"


def _signal(frame: Message, signal: Signal) -> str:
    selector = " M" if signal.selects else "" if signal.selected_by is None else f" m{signal.selected_by}"
    sign = "-" if signal.signed else "+"
    receiver = HOST_NAME if frame.sender != HOST_NAME else "Vector__XXX"
    place = f"{signal.start}|{signal.bits}@1{sign} ({signal.scale:.12g},0)"
    return f' SG_ {signal.name}{selector} : {place} [0|0] "{signal.unit}" {receiver}'


def _choices(frame: Message, signal: Signal) -> str:
    words = " ".join(f'{number} "{word}"' for number, word in sorted(signal.choices.items()))
    return f"VAL_ {frame.frame_id} {signal.name} {words} ;"


if __name__ == "__main__":
    DBC_FILE.write_text(dbc_text())
    CLASSIC_DBC_FILE.write_text(dbc_text(profile="classic"))
    print(DBC_FILE, CLASSIC_DBC_FILE, sep="\n")
