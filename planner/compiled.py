"""One typed door to the compiler: numba's decorators carry no types of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Return the function compiled to machine code on its first call, kept on disk beside its source."""
    compile_function = cast(Callable[[F], F], numba.njit(cache=True))  # pyright: ignore[reportUnknownMemberType]
    return compile_function(function)
