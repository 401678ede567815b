"""Functions as machine code, by numba."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, which is kept beside the module."""
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def inlined(function: F) -> F:
    """The same, as part of each function that calls it, for where a call would take long."""
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True)(function))


def compiled_parallel(function: F) -> F:
    """The same, with `prange` over all of numba's threads."""
    return cast("F", numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)(function))
