"""Golden bags: recordings that stand for what is right, with a manifest that says what each is, and why it is there."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from feedopt_recorder.bags.messages import bag_files
from feedopt_tools.errors import GoldenBagError
from feedopt_tools.replay.comparison import Tolerances

MANIFEST = "manifest.yaml"
MOST_BYTES = 2_000_000
PROGRAMS = "programs"
_BESIDE = frozenset({MANIFEST, PROGRAMS, "README.md"})
_HEADER = (
    "# Golden bags: what each is, why it is there, how far a replay may differ from it (see docs/replay.md).\n"
    "# Written by `feedopt replay --update`, which remakes the bags; sha256 is that of the MCAP file.\n"
)


@dataclass(frozen=True)
class GoldenBag:
    """Entry of the manifest.

    Attributes:
        what: what was recorded.
        why: what a difference would tell.
        program: program file, from the folder of the manifest; most stand in its folder ``programs``.
        machine: machine file or its name.
        method: planning method; empty: as in config/nodes/planner.yaml.
        sha256: of the MCAP file; empty before it is first made.
        tolerances: largest differences relative to the largest value of a field, by ``/topic`` or ``/topic.field``.
    """

    what: str
    why: str
    program: str
    machine: str
    method: str = ""
    sha256: str = ""
    tolerances: Mapping[str, float] = field(default_factory=dict)


def load_manifest(folder: Path) -> dict[str, GoldenBag]:
    """Golden bags of a folder by the name of their own folder.

    Raises:
        GoldenBagError: the manifest cannot be read, or an entry is not one.
    """
    path = folder / MANIFEST
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
        return {str(name): GoldenBag(**entry) for name, entry in document["bags"].items()}
    except (OSError, yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        raise GoldenBagError(f"{path}: is no manifest of golden bags: {error}") from error


def write_manifest(folder: Path, bags: Mapping[str, GoldenBag]) -> None:
    """Write the manifest. Raises OSError."""
    entries: dict[str, Any] = {name: asdict(bag) for name, bag in bags.items()}
    text = yaml.safe_dump({"bags": entries}, sort_keys=False, width=110, allow_unicode=True)
    (folder / MANIFEST).write_text(_HEADER + text, encoding="utf-8")


def chosen_bags(paths: Iterable[Path]) -> list[Path]:
    """Bags named on a command line: a folder with a manifest means its bags; what stands beside bags is left out."""
    chosen: list[Path] = []
    for path in paths:
        if (path / MANIFEST).is_file():
            chosen += [path / name for name in load_manifest(path)]
        elif path.name not in _BESIDE:
            chosen.append(path)
    return chosen


def golden_entry(path: Path) -> GoldenBag | None:
    """Entry of a bag in the manifest beside it; None where there is none. Raises GoldenBagError."""
    folder = path.absolute().parent
    return load_manifest(folder).get(path.absolute().name) if (folder / MANIFEST).is_file() else None


def checked_tolerances(path: Path) -> Tolerances:
    """Tolerances of a bag: those of its manifest, after its hash and size were checked.

    Raises:
        GoldenBagError: the file is not the one of the manifest, or too large.
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
    """Put a new recording in the place of a golden bag and note its hash.

    Raises:
        GoldenBagError: it is too large, or the manifest has no entry for it.
    """
    _check_size(made)
    bags = load_manifest(path.parent)
    if path.name not in bags:
        raise GoldenBagError(f"{path.parent / MANIFEST}: has no entry {path.name}; say there what the bag is and why")
    shutil.rmtree(path, ignore_errors=True)
    shutil.copytree(made, path)
    bags[path.name] = replace(bags[path.name], sha256=bag_hash(path))
    write_manifest(path.parent, bags)


def _check_size(path: Path) -> None:
    size = sum(file.stat().st_size for file in bag_files(path))
    if size > MOST_BYTES:
        raise GoldenBagError(f"{path}: has {size} bytes; golden bags have at most {MOST_BYTES}: take a shorter program")
