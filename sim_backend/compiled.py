"""One typed door to numba, whose decorators carry no types of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Return a function that is compiled when first called and kept in the cache."""
    compile_function = cast(Callable[[F], F], numba.njit(cache=True))  # pyright: ignore[reportUnknownMemberType]
    return compile_function(function)
