"""One typed door to the compiler: numba's decorators carry no types of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba.core import config

from preshape.hal.kernel_cache import CompilerConfig, keep_kernel

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Return the function compiled to machine code on its first call and kept on disk (`hal.kernel_cache`)."""
    dispatcher = cast(Any, numba.njit(nogil=True)(function))  # pyright: ignore[reportUnknownMemberType]
    if dispatcher is not function:
        keep_kernel(dispatcher, function, cast(CompilerConfig, config))
    return cast(F, dispatcher)
