"""Kernels ready before a loop in real time begins: to compile one takes seconds, to load one milliseconds.

A compiler that types functions by their arguments cannot compile before the first call. The signatures that a
process has called its kernels with are therefore kept beside the machine code, for the processes after it.
"""

from __future__ import annotations

import os
import pickle
from contextlib import suppress
from pathlib import Path
from typing import Any

from preshape.hal.kernel_cache import KERNELS


def remember_signatures() -> None:
    """Keep what this process's kernels have been called with, besides what is kept already."""
    for dispatcher, file in KERNELS:
        known = _signatures(file)
        called = {repr(signature): signature for signature in dispatcher.signatures}
        if called.keys() - known.keys():
            _write(file, known | called)


def warm_up() -> int:
    """Load or compile every kernel of this process for every signature that is kept; return how many there were."""
    count = 0
    for dispatcher, file in KERNELS:
        for signature in _signatures(file).values():
            dispatcher.compile(signature)
            count += 1
    return count


def _signatures(file: Path) -> dict[str, Any]:
    """Return signatures by their text; nothing where none are kept, or none that can be read."""
    try:
        return pickle.loads(file.read_bytes())
    except (OSError, EOFError, pickle.UnpicklingError):
        return {}


def _write(file: Path, signatures: dict[str, Any]) -> None:
    """Replace a file whole; several processes may do so at once."""
    part = file.with_name(f"{file.name}.{os.getpid()}")
    with suppress(OSError):
        part.write_bytes(pickle.dumps(signatures))
        part.replace(file)
