"""``feedopt replay``: run recorded inputs again and list the differences."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import click

from feedopt_core.errors import ConfigError
from feedopt_tools.command.exit_codes import FAILURE, OK
from feedopt_tools.command.text_output import TEXT_OUTPUT, is_standard_output, text_output
from feedopt_tools.command.workspace import workspace_root
from feedopt_tools.replay.golden import checked_tolerances, chosen_bags, golden_entry
from feedopt_tools.replay.replay import Replay, long_text, replay_bag, short_text

_GOLDEN_FOLDER = "bags"


@click.command()
@click.argument("bags", nargs=-1, type=click.Path(path_type=Path))
@click.option("--diff", type=TEXT_OUTPUT, help="File for the list of differences; - is standard output.")
@click.option("--live", is_flag=True, help="Execute the programs on a running graph instead, in real time.")
@click.option("--update", is_flag=True, help="Remake golden bags; prints a summary for the commit message.")
def command(bags: tuple[Path, ...], diff: Path | None, live: bool, update: bool) -> None:
    """Run each stage with its recorded inputs from BAGS and compare every output message with the recorded one.

    Default for BAGS: the golden bags of the workspace. Fails if a message differs by more than its tolerance.
    """
    chosen = chosen_bags(bags or (workspace_root() / _GOLDEN_FOLDER,))
    if not chosen:
        raise ConfigError("there is no bag to replay")
    if update:
        if live or diff is not None:
            raise click.UsageError("--update cannot be combined with --live or --diff")
        _update(chosen)
        return
    to_stderr = is_standard_output(diff)
    replays = [_replayed(path, live=live, to_stderr=to_stderr) for path in chosen]
    if diff is not None:
        with text_output(diff) as file:
            file.write("\n".join(line for replay in replays for line in long_text(replay)) + "\n")
    differing = [replay for replay in replays if not replay.agrees]
    if len(replays) > 1:
        click.echo(f"{len(replays) - len(differing)} of {len(replays)} bags agree", err=to_stderr)
    sys.exit(FAILURE if differing else OK)


def _replayed(path: Path, *, live: bool, to_stderr: bool) -> Replay:
    tolerances = checked_tolerances(path)
    if live:
        from feedopt_tools.replay.live import record_again
        from feedopt_tools.replay.recorded_program import RecordedProgram
        from feedopt_tools.replay.replay import compare_bags

        with tempfile.TemporaryDirectory(prefix="feedopt-live-") as folder:
            again = record_again(RecordedProgram(path), Path(folder), _say)
            replay = compare_bags(path, again, tolerances)
    else:
        replay = replay_bag(path, tolerances)
    for line in short_text(replay):
        click.echo(line, err=to_stderr)
    return replay


def _update(paths: list[Path]) -> None:
    for path in paths:
        if golden_entry(path) is None:
            raise ConfigError(f"{path}: is not a golden bag: no manifest in its folder has an entry of that name")
    from feedopt_tools.replay.update import remake

    for path in paths:
        for line in remake(path.absolute(), _say):
            click.echo(line)


def _say(text: str) -> None:
    click.echo(text, err=True)
