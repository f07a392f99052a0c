"""Text for a file, or for standard output where it is called ``-``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO, cast

import click

from feedopt_core.errors import ConfigError

TEXT_OUTPUT = click.Path(path_type=Path, dir_okay=False, allow_dash=True)
"""Type of an option that names a text file to write."""


@contextmanager
def text_output(path: Path) -> Iterator[TextIO]:
    """The file to write, or standard output.

    Raises:
        ConfigError: the file cannot be written.
    """
    try:
        with click.open_file(str(path), "w", encoding="utf-8") as file:
            yield cast("TextIO", file)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def is_standard_output(path: Path | None) -> bool:
    """The result itself goes to standard output: what is said beside it belongs on standard error."""
    return path is not None and str(path) == "-"
