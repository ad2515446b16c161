"""What all tests share: the helpers beside them are importable, and the long ones come first."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

# In pytest's importlib mode this folder is not on the path.
sys.path.insert(0, str(Path(__file__).parent))

_LONG = ("slow", "physics", "bus")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put long tests first, the longest kind before all: at the end of a run no worker waits long for another."""
    items.sort(
        key=lambda item: next((rank for rank, mark in enumerate(_LONG) if item.get_closest_marker(mark)), len(_LONG))
    )
