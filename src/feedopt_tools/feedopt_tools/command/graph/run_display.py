"""Progress of a run: a bar on a terminal, otherwise lines of text."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from feedopt_tools.execute.client import Progress
from feedopt_tools.execute.execution import RunEvents


class RunDisplay:
    """Shows stages and progress while a program is executed."""

    def __init__(self, console: Console) -> None:
        self.events = RunEvents(stage=self._stage, progress=self._progress)
        self._console = console
        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:.0f} of {task.total:.0f} mm"),
            TextColumn("{task.fields[planned]}"),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task("motion", total=1.0, visible=False, planned="")

    def __enter__(self) -> RunDisplay:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def _stage(self, text: str) -> None:
        self._console.print(text, highlight=False)

    def _progress(self, progress: Progress) -> None:
        if progress.s_published_mm > 0.0:
            self._bar.update(
                self._task,
                total=progress.s_published_mm,
                completed=progress.s_commanded_mm,
                visible=True,
                planned=f"planned to {progress.s_committed_mm:.0f} mm, {progress.motion_time_s:.1f} s",
            )
