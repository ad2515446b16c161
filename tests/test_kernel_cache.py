"""The kernel cache notices an edit in any file that a kernel depends on, and does without a directory."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from preshape.hal import kernel_cache
from preshape.hal.source_digest import imported, source_digest, source_files

PACKAGE = Path(kernel_cache.__file__).parents[1]
KERNEL = """
from preshape.hal.compiled import compiled
from preshape.planner.deep import FACTOR, scaled

@compiled
def kernel(x: float) -> float:
    return scaled(x) + FACTOR
"""
DEEP = """
from preshape.hal.compiled import compiled
from preshape.hal.number import FACTOR

@compiled
def scaled(x: float) -> float:
    return FACTOR * x
"""
PROGRAM = """
from preshape.planner.kernel import kernel
value = kernel(10.0)
print(value, sum(kernel.stats.cache_hits.values()))
"""


REMEMBERING = """
from preshape.planner.kernel import kernel
from preshape.hal.kernel_warm_up import remember_signatures
kernel(10.0)
kernel(10)
remember_signatures()
"""
WARMED = """
from preshape.planner.kernel import kernel
from preshape.hal.kernel_warm_up import warm_up
print(warm_up(), len(kernel.signatures), sum(kernel.stats.cache_hits.values()), sum(kernel.stats.cache_misses.values()))
"""


def _package(root: Path) -> Path:
    """Write a small package of two kernel files and one constant, with this project's cache in it."""
    package = root / "preshape"
    for folder in ("", "hal", "planner"):
        (package / folder).mkdir(parents=True, exist_ok=True)
        (package / folder / "__init__.py").write_text("")
    for file in ("hal/kernel_cache.py", "hal/kernel_warm_up.py", "hal/source_digest.py", "hal/compiled.py"):
        shutil.copy(PACKAGE / file, package / file)
    (package / "planner/kernel.py").write_text(KERNEL)
    (package / "planner/deep.py").write_text(DEEP)
    (package / "hal/number.py").write_text("FACTOR = 2.0\n")
    return package


def _run(root: Path, cache: Path) -> tuple[float, int]:
    """Return the kernel's value at 10 in a new process, and how many times it came from the cache."""
    value, hits = _print(root, cache, PROGRAM).split()
    return float(value), int(hits)


def _print(root: Path, cache: Path, program: str) -> str:
    """Return what a program prints that runs in a new process with this package and kernel cache."""
    environment = {**os.environ, "PYTHONPATH": str(root), "XDG_CACHE_HOME": str(cache)}
    environment.pop("NUMBA_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True, cwd=root
    )
    return done.stdout


def test_an_edited_constant_two_imports_away_reaches_the_kernel(tmp_path: Path) -> None:
    package = _package(tmp_path)
    assert _run(tmp_path, tmp_path / "cache") == (22.0, 0)
    assert _run(tmp_path, tmp_path / "cache") == (22.0, 1)
    (package / "hal/number.py").write_text("FACTOR = 3.0\n")
    assert _run(tmp_path, tmp_path / "cache") == (33.0, 0)


def test_a_later_process_loads_every_remembered_kernel_before_its_first_call(tmp_path: Path) -> None:
    package = _package(tmp_path)
    assert _print(tmp_path, tmp_path / "cache", WARMED).split()[:2] == ["0", "0"]
    _print(tmp_path, tmp_path / "cache", REMEMBERING)
    # Two signatures of the kernel, and of the one that it calls; nothing is compiled anew.
    assert _print(tmp_path, tmp_path / "cache", WARMED).split() == ["4", "2", "2", "0"]
    for file in (tmp_path / "cache").rglob("*.signatures"):
        file.write_bytes(b"no pickle")
    assert _print(tmp_path, tmp_path / "cache", WARMED).split()[0] == "0"
    (package / "hal/number.py").write_text("FACTOR = 3.0\n")
    assert _print(tmp_path, tmp_path / "cache", WARMED).split()[0] == "0"


def test_without_a_writable_directory_kernels_still_run(tmp_path: Path) -> None:
    _package(tmp_path)
    blocked = tmp_path / "cache"
    blocked.write_text("a file where the directory should be")
    for _ in range(2):
        assert _run(tmp_path, blocked) == (22.0, 0)
    assert not list(tmp_path.rglob("*.nbc"))


def test_imports_are_found_in_every_form_the_package_uses() -> None:
    text = "from preshape.a.b import c\nfrom preshape.d import (\n  e,\n  f as g,\n)\nimport preshape.h\nimport os\n"
    assert {"preshape.a.b", "preshape.d.e", "preshape.d.f", "preshape.h"} <= imported(text)
    assert not any("os" in name for name in imported(text))


def test_a_file_depends_on_what_it_imports_and_on_nothing_else() -> None:
    files = source_files(PACKAGE / "control/field_kernel.py", PACKAGE)
    assert PACKAGE / "hal/sah_hand.py" in files
    assert PACKAGE / "control/task_grasp.py" not in files


def test_every_kernel_file_has_a_digest_of_its_own() -> None:
    kernels = [file for folder in ("planner", "control") for file in (PACKAGE / folder).glob("*.py")]
    kernels = [file for file in kernels if "import compiled" in file.read_text()]
    assert len({source_digest(file, PACKAGE) for file in kernels}) == len(kernels) > 5


def test_only_the_newest_versions_of_a_file_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(20):
        old = tmp_path / f"mine-{number:016x}"
        old.mkdir()
        os.utime(old, (number, number))
    (tmp_path / "other-0000000000000000").mkdir()
    source = PACKAGE / "hal/mine.py"
    monkeypatch.setattr(kernel_cache, "source_digest", lambda path, root: "f" * 16)
    assert kernel_cache.kernel_directory(source, tmp_path) == tmp_path / f"mine-{'f' * 16}"
    kept = {path.name for path in tmp_path.glob("mine-*")}
    assert kept == {f"mine-{'f' * 16}"} | {f"mine-{number:016x}" for number in range(21 - kernel_cache.KEPT, 20)}
    assert (tmp_path / "other-0000000000000000").exists()
