"""What each classic frame holds: the messages of the FD profile cut into slices, for a DBC file of their own."""

from __future__ import annotations

from dataclasses import replace

from preshape.hal.can.dbc_message import Message, Signal
from preshape.hal.can.slices import CLASSIC_BYTES, SLICE_BYTES, slice_count

HEAD_BITS = 16
"""Bits of a slice before its part of the payload: its number and its tag."""
SLICE_BITS = 8 * SLICE_BYTES


def sliced(message: Message) -> Message:
    """Return the classic frame of a message: itself if it fits, else one whose slice number selects its signals.

    A signal that lies in two slices becomes two, `<name>_low` and `<name>_high`, whose physical values add up to its
    own. What a parameter's value means is told in another slice than its end: it stays a number of 32 bits. Slices that
    hold only what fills an FD frame up have a signal as well, for a reader must know every number of a slice.
    """
    if message.length <= CLASSIC_BYTES:
        return message
    signals = [
        Signal(name="slice", start=0, bits=8, selects=True),
        Signal(name="slice_tag", start=8, bits=8),
    ]
    values = [signal for signal in message.signals if signal.selected_by is not None]
    plain = [replace(signal, selects=False) for signal in message.signals if signal.selected_by is None]
    if values:
        plain.append(Signal(name="value", start=values[0].start, bits=values[0].bits))
    for signal in sorted(plain, key=lambda signal: signal.start):
        signals += _parts(signal)
    told = {signal.selected_by for signal in signals}
    for number in range(slice_count(message.length)):
        if number not in told:
            signals.append(Signal(name=f"padding_{number}", start=HEAD_BITS, bits=SLICE_BITS, selected_by=number))
    return Message(message.frame_id, message.name, message.sender, CLASSIC_BYTES, tuple(signals))


def _parts(signal: Signal) -> list[Signal]:
    first, last = signal.start // SLICE_BITS, (signal.start + signal.bits - 1) // SLICE_BITS
    start = HEAD_BITS + signal.start - first * SLICE_BITS
    if first == last:
        return [replace(signal, start=start, selected_by=first)]
    below = last * SLICE_BITS - signal.start
    return [
        replace(signal, name=f"{signal.name}_low", start=start, bits=below, signed=False, selected_by=first),
        replace(
            signal,
            name=f"{signal.name}_high",
            start=HEAD_BITS,
            bits=signal.bits - below,
            scale=signal.scale * 2.0**below,
            selected_by=last,
        ),
    ]
