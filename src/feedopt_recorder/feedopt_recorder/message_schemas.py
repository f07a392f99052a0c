"""Message definitions as MCAP carries them, gathered from the installed packages, without ROS.

The ``ros2msg`` encoding is the definition's own text, then for every type it uses, directly or not, a line of 80 ``=``,
a line ``MSG: package/Name`` and that type's text.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from feedopt_core.errors import ConfigError

SEPARATOR = "=" * 80
_PRIMITIVES = frozenset(
    [
        "bool",
        "byte",
        "char",
        "float32",
        "float64",
        "int8",
        "uint8",
        "int16",
        "uint16",
        "int32",
        "uint32",
        "int64",
        "uint64",
        "string",
        "wstring",
    ]
)
_FIELD = re.compile(r"^\s*([A-Za-z][A-Za-z0-9_]*(?:/[A-Za-z][A-Za-z0-9_]*)*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[A-Za-z]")


def ament_share_directories() -> tuple[Path, ...]:
    """The ``share`` folders of the ament prefixes in ``AMENT_PREFIX_PATH``, in their order."""
    prefixes = [prefix for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    return tuple(Path(prefix) / "share" for prefix in prefixes)


class MessageSchemas:
    """Definitions and type hashes of messages.

    Args:
        share_directories: folders holding ``<package>/msg/<Name>.msg``; the first that has a definition wins.
    """

    def __init__(self, share_directories: Sequence[Path]) -> None:
        self._share_directories = tuple(share_directories)
        self._texts: dict[str, str] = {}

    def schema(self, type_name: str) -> str:
        """Definition of ``package/msg/Name`` with everything it uses. Raises ConfigError where one is missing."""
        package, folder, name = _split(type_name)
        pending = [f"{package}/{folder}/{name}"]
        gathered: dict[str, str] = {}
        while pending:
            current = pending.pop(0)
            if current not in gathered:
                gathered[current] = self._text(current)
                pending += _dependencies(gathered[current], current.split("/")[0])
        own, *others = gathered.items()
        parts = [own[1].rstrip() + "\n"]
        for other, text in others:
            package, _, name = _split(other)
            parts.append(f"{SEPARATOR}\nMSG: {package}/{name}\n{text.rstrip()}\n")
        return "".join(parts)

    def type_hash(self, type_name: str) -> str:
        """``RIHS01_...`` hash of a type, read from its installed type description; empty where none is installed."""
        package, folder, name = _split(type_name)
        path = self._find(package, folder, f"{name}.json")
        if path is None:
            return ""
        hashes = json.loads(path.read_text(encoding="utf-8")).get("type_hashes", [])
        return next((str(entry["hash_string"]) for entry in hashes if entry["type_name"] == type_name), "")

    def _text(self, type_name: str) -> str:
        if type_name not in self._texts:
            package, folder, name = _split(type_name)
            path = self._find(package, folder, f"{name}.msg")
            if path is None:
                places = ", ".join(map(str, self._share_directories)) or "none: AMENT_PREFIX_PATH is not set"
                raise ConfigError(
                    f"no definition of {type_name} below {places}; source the workspace, or run ./feedopt"
                )
            self._texts[type_name] = path.read_text(encoding="utf-8")
        return self._texts[type_name]

    def _find(self, package: str, folder: str, file_name: str) -> Path | None:
        paths = (directory / package / folder / file_name for directory in self._share_directories)
        return next((path for path in paths if path.is_file()), None)


def _split(type_name: str) -> tuple[str, str, str]:
    package, *folder, name = type_name.split("/")
    if not package or len(folder) > 1 or not name:
        raise ConfigError(f"{type_name!r} is not a message type; a message type reads package/msg/Name")
    return package, folder[0] if folder else "msg", name


def _dependencies(text: str, package: str) -> Iterator[str]:
    """Full names of the message types a definition uses, in the order they appear."""
    for line in text.splitlines():
        match = _FIELD.match(line.split("#", 1)[0])
        if match is None or match[1] in _PRIMITIVES:
            continue
        used = match[1] if "/" in match[1] else f"{package}/{match[1]}"
        yield "/".join(_split(used))
