"""Golden bags: reference recordings, with a manifest that says what each one holds and why it is kept."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from feedopt_core.config_files import parse_yaml, read_text
from feedopt_core.errors import ConfigError
from feedopt_core.schema import build, parameter
from feedopt_recorder.bags.messages import bag_files
from feedopt_tools.errors import GoldenBagError
from feedopt_tools.replay.comparison import Tolerances

MANIFEST = "manifest.yaml"
MOST_BYTES = 2_000_000
PROGRAMS = "programs"
_BESIDE = frozenset({MANIFEST, PROGRAMS, "README.md"})
_HEADER = (
    "# Golden bags: what each holds, why it is kept, and the tolerances of its replay (see docs/replay.md).\n"
    "# Written by `feedopt replay --update`, which remakes the bags; sha256 is that of the MCAP file.\n"
)


@dataclass(frozen=True)
class GoldenBag:
    """Entry of the manifest."""

    what: str = parameter("What was recorded.")
    why: str = parameter("What a difference would mean.")
    program: str = parameter("Program file, relative to the folder of the manifest.")
    machine: str = parameter("Machine file or its name.")
    method: str = parameter("Planning method; empty: as in config/nodes/planner.yaml.", default="")
    sha256: str = parameter("Hash of the MCAP file; empty before the first recording.", default="")
    tolerances: Mapping[str, float] = parameter(
        "Largest differences relative to the largest value of a field, by /topic or /topic.field.",
        default_factory=dict,
        at_least=0.0,
    )


@dataclass(frozen=True)
class _Manifest:
    bags: Mapping[str, GoldenBag] = parameter("Golden bags by the name of their folder.")


def load_manifest(folder: Path) -> dict[str, GoldenBag]:
    """Golden bags of a folder, by folder name.

    Raises:
        GoldenBagError: the manifest cannot be read, or an entry is not one; names entry and key.
    """
    path = folder / MANIFEST
    try:
        return dict(build(_Manifest, parse_yaml(read_text(path), str(path)), str(path)).bags)
    except ConfigError as error:
        raise GoldenBagError(str(error)) from error


def write_manifest(folder: Path, bags: Mapping[str, GoldenBag]) -> None:
    """Write the manifest. Raises OSError."""
    entries: dict[str, Any] = {name: asdict(bag) for name, bag in bags.items()}
    text = yaml.safe_dump({"bags": entries}, sort_keys=False, width=110, allow_unicode=True)
    (folder / MANIFEST).write_text(_HEADER + text, encoding="utf-8")


def chosen_bags(paths: Iterable[Path]) -> list[Path]:
    """Bags named on a command line. A folder with a manifest stands for its bags; other files there are skipped."""
    chosen: list[Path] = []
    for path in paths:
        if (path / MANIFEST).is_file():
            chosen += [path / name for name in load_manifest(path)]
        elif path.name not in _BESIDE:
            chosen.append(path)
    return chosen


def golden_entry(path: Path) -> GoldenBag | None:
    """Manifest entry of a bag; None if it has none. Raises GoldenBagError."""
    folder = path.absolute().parent
    return load_manifest(folder).get(path.absolute().name) if (folder / MANIFEST).is_file() else None


def checked_tolerances(path: Path) -> Tolerances:
    """Tolerances of a bag from its manifest. Hash and size of the bag are checked first.

    Raises:
        GoldenBagError: the hash is not that of the manifest, or the file is too large.
        BagError: there is no bag.
    """
    entry = golden_entry(path)
    if entry is None:
        return Tolerances()
    found = bag_hash(path)
    if found != entry.sha256:
        raise GoldenBagError(
            f"{path}: is not the bag of {MANIFEST} (sha256 {found[:12]}..., not {entry.sha256[:12] or 'none'}...): "
            "restore it, or remake it with feedopt replay --update"
        )
    _check_size(path)
    return Tolerances(entry.tolerances)


def bag_hash(path: Path) -> str:
    """SHA-256 of the MCAP file of a bag. Raises BagMissingError."""
    return hashlib.sha256(bag_files(path)[0].read_bytes()).hexdigest()


def replace_bag(path: Path, made: Path) -> None:
    """Replace a golden bag by a new recording and update its hash.

    Raises:
        GoldenBagError: it is too large, or the manifest has no entry for it.
    """
    _check_size(made)
    bags = load_manifest(path.parent)
    if path.name not in bags:
        raise GoldenBagError(f"{path.parent / MANIFEST}: has no entry {path.name}; add one with what and why")
    shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(made, path)
    bags[path.name] = replace(bags[path.name], sha256=bag_hash(path))
    write_manifest(path.parent, bags)


def _check_size(path: Path) -> None:
    size = sum(file.stat().st_size for file in bag_files(path))
    if size > MOST_BYTES:
        raise GoldenBagError(f"{path}: has {size} bytes; golden bags have at most {MOST_BYTES}: take a shorter program")
