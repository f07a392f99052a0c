"""Text output to a file, or to standard output if the file name is ``-``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TextIO, cast

import click

from feedopt_core.errors import ConfigError

TEXT_OUTPUT = click.Path(path_type=Path, dir_okay=False, allow_dash=True)
"""Type of an option that names a text file to write."""


def open_text(path: Path) -> AbstractContextManager[TextIO]:
    """As :func:`text_output`, for commands that have an error of their own. Raises OSError."""
    return cast("AbstractContextManager[TextIO]", click.open_file(str(path), "w", encoding="utf-8"))


@contextmanager
def text_output(path: Path) -> Iterator[TextIO]:
    """Open the file for writing, or give standard output.

    Raises:
        ConfigError: the file cannot be written.
    """
    try:
        with open_text(path) as file:
            yield file
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def is_standard_output(path: Path | None) -> bool:
    """Whether the result goes to standard output; all other messages then belong to standard error."""
    return path is not None and str(path) == "-"
