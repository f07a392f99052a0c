"""Compilation of numerical loops to machine code that is kept on disk for as long as its sources stay the same.

numba stamps the code it keeps with the file of the function alone. Constants and functions that this file imports are
frozen into the machine code too, and would stay as they were. So the stamp here covers every module of the core that
the file imports, directly or through others. docs/decisions/0015-compiled-code.md has the reasons.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numba import njit
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
    UserWideCacheLocator,
)

_P = ParamSpec("_P")
_R = TypeVar("_R")

_CORE = Path(__file__).parent
_IMPORT = re.compile(rf"^\s*(?:from|import)\s+({_CORE.name}(?:\.\w+)*)", re.MULTILINE)
_LOCK = "compiled.lock"


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function on its first call; the machine code is kept on disk beside its module.

    Strict IEEE arithmetic and one thread: the same input gives the same bytes. A compiled function may call compiled
    functions of other modules of the core and use their constants.
    """
    dispatcher: Any = njit(nogil=True, fastmath=False)(function)
    # What njit(cache=True) does, with another stamp. There is no public way to choose one.
    dispatcher._cache = _SourcesCache(function)
    kernel: Callable[_P, _R] = dispatcher
    return kernel


@cache
def source_stamp(path: Path) -> str:
    """Hash of a module with every module of the core that it imports, and of numpy's version.

    Args:
        path: file of the module.
    """
    stamp = hashlib.sha256(np.__version__.encode())
    for source in sorted(source_files(path)):
        stamp.update(_digest(source))
    return stamp.hexdigest()


def source_files(path: Path) -> set[Path]:
    """Files of a module and of every module of the core that it imports, directly or through others.

    Found by their import statements wherever these stand, so more than what one run imports. Relative imports and
    imports by computed names are not seen; the linter forbids the first, and kernels need neither.
    """
    # Importing a module runs the __init__ of each package it is in.
    packages = [folder / "__init__.py" for folder in path.parents if folder.is_relative_to(_CORE)]
    found, waiting = set[Path](), [path, *packages]
    while waiting:
        source = waiting.pop()
        if source not in found:
            found.add(source)
            waiting.extend(_imported(source))
    return found


@cache
def _digest(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


@cache
def _imported(path: Path) -> frozenset[Path]:
    """Files that the import statements of a file name, packages on the way included."""
    text = path.read_text(encoding="utf-8")
    found = set[Path]()
    for name in set(_IMPORT.findall(text)):
        folder = _CORE
        found.add(folder / "__init__.py")
        for part in name.split(".")[1:]:
            if (folder / part).is_dir():
                folder /= part
                found.add(folder / "__init__.py")
            else:
                # Where there is no such file the name is a thing in the package, which is in already.
                folder = folder / f"{part}.py"
                break
        if folder.is_dir():
            found |= _used_modules(folder, text)
        elif folder.is_file():
            found.add(folder)
    return frozenset(found)


def _used_modules(package: Path, text: str) -> set[Path]:
    """Modules of an imported package whose names occur in a text."""
    found = set[Path]()
    for entry in package.iterdir():
        if not re.search(rf"\b{entry.stem}\b", text):
            continue
        if entry.suffix == ".py":
            found.add(entry)
        elif (entry / "__init__.py").is_file():
            found |= {entry / "__init__.py"} | _used_modules(entry, text)
    return found


@cache
def _tell_of_compilation() -> None:
    """Say once a process why it takes so long."""
    logging.getLogger(__name__).warning("feedopt: compiling numerical code that has changed; this takes some seconds")


class _SourcesLocator:
    """Stands before a locator of numba: where the code is kept, and under which stamp."""

    _py_file: str
    _lineno: int

    def get_source_stamp(self) -> str:
        return source_stamp(Path(self._py_file))

    def get_disambiguator(self) -> str:
        # The stamp in the name too: numba writes the index before the code, and what stops between the two would
        # leave the old code under the new stamp.
        return f"{self._lineno}-{self.get_source_stamp()[:12]}"


class _ChosenFolder(_SourcesLocator, UserProvidedCacheLocator):
    """NUMBA_CACHE_DIR."""


class _FolderOfModule(_SourcesLocator, InTreeCacheLocator):
    """``__pycache__`` beside the module."""


class _FolderOfUser(_SourcesLocator, UserWideCacheLocator):
    """Folder in the home of the user, where the one of the module cannot be written."""


class _SourcesCacheImpl(CompileResultCacheImpl):
    _locator_classes: list[type[object]] = [_ChosenFolder, _FolderOfModule, _FolderOfUser]  # noqa: RUF012 (as numba declares it)


class _SourcesCache(FunctionCache):
    """Machine code of one function on disk, shared by processes that may write at the same time."""

    _impl_class = _SourcesCacheImpl

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Kept code for a signature; None: it is compiled next."""
        found = super().load_overload(sig, target_context)
        if found is None:
            _tell_of_compilation()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code for a signature, and forget code made from earlier sources."""
        self._impl.locator.ensure_cache_path()
        folder, base = Path(self.cache_path), self._impl.filename_base
        # numba numbers the files by what the index holds: two processes could give two signatures one number.
        with (folder / _LOCK).open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            super().save_overload(sig, data)
        function, _, place = base.partition("-")
        for kept in folder.glob(f"{function}-*.{place.rpartition('.')[2]}*.nb[ci]"):
            if not kept.name.startswith(f"{base}."):
                kept.unlink(missing_ok=True)
