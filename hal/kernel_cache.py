"""Where compiled kernels are kept between processes: one directory per source file *and* all it imports.

The compiler's own cache looks at one file only and would go on serving machine code whose callees or
constants, in other files, have changed. Here the directory's name tells them apart.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, Protocol, cast

import preshape
from preshape.hal.source_digest import source_digest

PACKAGE_ROOT = Path(preshape.__file__).parent
KEPT = 12
"""How many versions of one source file's kernels stay on disk."""
KERNELS: list[tuple[Any, Path]] = []
"""Every kernel of this process that is kept: the dispatcher, and the file for the signatures it is called with."""
_LOCK = threading.Lock()


class CompilerConfig(Protocol):
    """The part of the compiler's configuration that says where it keeps machine code."""

    CACHE_DIR: str


def cache_root() -> Path | None:
    """Return the directory of all kernels: under NUMBA_CACHE_DIR, XDG_CACHE_HOME or ~/.cache; None without a home."""
    for variable in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        if os.environ.get(variable):
            return Path(os.environ[variable]) / "preshape"
    home = os.path.expanduser("~")
    return Path(home) / ".cache" / "preshape" if os.path.isabs(home) else None


@cache
def kernel_directory(source: Path, root: Path | None) -> Path | None:
    """Return the directory for the kernels of a source file, or None where nothing can be written or read."""
    if root is None:
        return None
    try:
        digest = source_digest(source, PACKAGE_ROOT)
        directory = root / f"{source.stem}-{digest}"
        if not directory.is_dir():
            directory.mkdir(parents=True, exist_ok=True)
            _forget_old(root, source.stem)
        tempfile.TemporaryFile(dir=directory).close()
    except OSError:
        return None
    return directory


def keep_kernel(dispatcher: Any, function: Any, config: CompilerConfig) -> None:
    """Let a dispatcher keep the machine code of `function`; without a directory it compiles in every process."""
    source = Path(cast(FunctionType, function).__code__.co_filename)
    directory = kernel_directory(source, cache_root())
    if directory is None:
        return
    with _LOCK:
        before, config.CACHE_DIR = config.CACHE_DIR, str(directory)
        try:
            dispatcher.enable_caching()
            # The directory's name stands for the source's content. The compiler's own stamp, a time, would only tell
            # apart checkouts, or a guest that sees the times of this machine's files in whole seconds.
            dispatcher._cache._cache_file._source_stamp = directory.name
        finally:
            config.CACHE_DIR = before
    KERNELS.append((dispatcher, directory / f"{cast(FunctionType, function).__qualname__}.signatures"))


def _forget_old(root: Path, stem: str) -> None:
    """Remove all but the newest versions; whoever still uses one compiles it again."""

    def age(directory: Path) -> float:
        try:
            return -directory.stat().st_mtime
        except FileNotFoundError:
            return float("inf")

    for directory in sorted(root.glob(f"{stem}-{'[0-9a-f]' * 16}"), key=age)[KEPT:]:
        shutil.rmtree(directory, ignore_errors=True)
