"""What a source file depends on inside this package: itself and, transitively, every module it imports."""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path

PACKAGE = "preshape"
_IMPORT = re.compile(
    rf"^[ \t]*(?:from[ \t]+({PACKAGE}[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+({PACKAGE}[\w.]*))",
    re.MULTILINE,
)
"""`from preshape.a import b, c` (also over several lines) and `import preshape.a`."""


@cache
def _text(path: Path) -> bytes:
    return path.read_bytes()


def imported(text: str) -> set[str]:
    """Return every dotted name inside the package that a source text may import a module by."""
    found: set[str] = set()
    for origin, names, plain in _IMPORT.findall(text):
        module = origin or plain
        found.add(module)
        found.update(f"{module}.{name}" for name in re.findall(r"\w+", names))
    return found


@cache
def _imports(path: Path, root: Path) -> frozenset[Path]:
    """Return the files of the package that one file imports; names that are no module name no file."""
    paths: set[Path] = set()
    for name in imported(_text(path).decode()):
        stem = root.joinpath(*name.split(".")[1:])
        paths.update(file for file in (stem.with_suffix(".py"), stem / "__init__.py") if file.is_file())
    return frozenset(paths)


def source_files(path: Path, root: Path) -> frozenset[Path]:
    """Return the file and all files of the package at `root` that it imports, directly or not."""
    found: set[Path] = set()
    left = [path]
    while left:
        file = left.pop()
        if file not in found:
            found.add(file)
            left.extend(_imports(file, root))
    return frozenset(found)


@cache
def source_digest(path: Path, root: Path) -> str:
    """Return 16 hexadecimal digits that change with any of `source_files`; `OSError` if one cannot be read.

    Files are read once in a process: what is running was imported from what was read.
    """
    digest = hashlib.sha256()
    for file in sorted(source_files(path, root)):
        digest.update(hashlib.sha256(_text(file)).digest())
    return digest.hexdigest()[:16]
