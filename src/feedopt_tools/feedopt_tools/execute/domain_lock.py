"""One graph a ROS domain: a lock that goes with the process that holds it."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path
from types import TracebackType

from feedopt_node.errors import SecondGraphError


def domain_id() -> int:
    """ROS domain of this process."""
    return int(os.environ.get("ROS_DOMAIN_ID") or 0)


class DomainLock:
    """Held while a graph runs; the operating system drops it with the process, however that ends.

    Args:
        domain: ROS domain.
        directory: folder of the lock files.

    Raises:
        SecondGraphError: on entry, another command holds it; the message names its process.
    """

    def __init__(self, domain: int, directory: Path | None = None) -> None:
        self._domain = domain
        self.path = (directory or Path(tempfile.gettempdir())) / f"feedopt-domain-{domain}.lock"
        self._descriptor = -1

    def __enter__(self) -> DomainLock:
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC
        try:
            self._descriptor = os.open(self.path, flags, 0o666)
        except PermissionError:
            # Another user made the file; a lock needs no right to write.
            self._descriptor = os.open(self.path, os.O_RDONLY | os.O_CLOEXEC)
            flags = os.O_RDONLY
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.read(self._descriptor, 32).decode(errors="replace").strip() or "unknown"
            os.close(self._descriptor)
            raise SecondGraphError(
                f"a graph already runs on ROS domain {self._domain} (process {holder}): wait for it, "
                "or choose another domain with ROS_DOMAIN_ID"
            ) from error
        if flags & os.O_RDWR:
            os.ftruncate(self._descriptor, 0)
            os.write(self._descriptor, str(os.getpid()).encode())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._descriptor)
