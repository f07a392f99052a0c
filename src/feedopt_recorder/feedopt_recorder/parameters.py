"""Parameters of the recorder node."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from feedopt_core.schema import parameter
from feedopt_node.parameters import GraphParameters
from feedopt_recorder.bag_writer import FLUSH_INTERVAL_S


@dataclass(frozen=True)
class RecorderParameters(GraphParameters):
    """What the recorder needs to know."""

    bag_directory: str = parameter(
        "Folder of the bag, which must not exist yet; empty: a new folder below bags/, named after the time.",
        default="",
    )
    provenance_file: str = parameter(
        "JSON file with the records that say where the run comes from; empty: none.", default=""
    )
    poll_interval_s: float = parameter(
        "How often the topics are drained.", default=0.02, unit="s", at_least=0.001, at_most=0.1
    )
    flush_interval_s: float = parameter(
        "What a crash may lose at most: a chunk is written at the latest after this time.",
        default=FLUSH_INTERVAL_S,
        unit="s",
        at_least=0.05,
        at_most=10.0,
    )

    def directory(self) -> Path:
        """Folder of the bag to write."""
        if self.bag_directory:
            return Path(self.bag_directory).expanduser().absolute()
        return Path("bags", datetime.now(tz=UTC).strftime("run_%Y%m%d_%H%M%S")).absolute()
