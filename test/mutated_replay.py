"""Replays a bag with one formula changed: ``python mutated_replay.py BAG MODULE FILE``; FILE is the changed module.

The module is loaded from its changed file, so that its compiled functions are compiled anew; every other module is the
one that is installed.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections.abc import Sequence
from types import ModuleType


class OneModule(importlib.abc.MetaPathFinder):
    """Finds one module in a file of its own."""

    def __init__(self, name: str, path: str) -> None:
        self.name = name
        self.path = path

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The changed file for that module."""
        return importlib.util.spec_from_file_location(fullname, self.path) if fullname == self.name else None


if __name__ == "__main__":
    bag, module, changed = sys.argv[1:]
    sys.meta_path.insert(0, OneModule(module, changed))
    from feedopt_tools.command.main import main

    main(["replay", bag])
