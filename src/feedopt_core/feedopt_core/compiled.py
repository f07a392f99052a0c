"""Compilation of numerical loops to machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from numba import njit

_P = ParamSpec("_P")
_R = TypeVar("_R")


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function on its first call; the machine code is kept on disk beside its module.

    Strict IEEE arithmetic and one thread: the same input gives the same bytes. A compiled function may call compiled
    functions of its own module only: numba looks at that one file to find out whether the code on disk is still good.
    """
    dispatcher: Callable[_P, _R] = njit(cache=True, nogil=True, fastmath=False)(function)
    return dispatcher
