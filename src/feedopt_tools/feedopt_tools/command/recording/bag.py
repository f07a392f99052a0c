"""``feedopt bag``: show the content of a recording, check it for gaps, and repair it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from feedopt_core.errors import ConfigError
from feedopt_recorder.bags.check_bag import check_bag
from feedopt_recorder.bags.messages import BagContents, bag_files, read_messages
from feedopt_recorder.bags.metadata_yaml import metadata_findings
from feedopt_recorder.bags.repair import repair_bag
from feedopt_recorder.errors import BagEmptyError
from feedopt_tools.command.exit_codes import FAILURE, OK


@click.group()
def command() -> None:
    """Show, check and repair a recording: a bag, or the folder of a run."""


@command.command()
@click.argument("bag", type=click.Path(path_type=Path))
def info(bag: Path) -> None:
    """Show topics, times and provenance of BAG."""
    contents = read_messages(bag, allow_truncated=True)
    console = Console()
    summary = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, text in _facts(bag, contents):
        summary.add_row(name, text)
    console.print(summary)
    topics = Table(box=None, padding=(0, 2, 0, 0))
    for column, justify in (("topic", "left"), ("messages", "right"), ("Hz", "right"), ("type", "left")):
        topics.add_column(column, justify="right" if justify == "right" else "left", no_wrap=True)
    for topic in contents.topics.values():
        span_s = (int(topic.log_ns[-1]) - int(topic.log_ns[0])) * 1e-9 if len(topic) > 1 else 0.0
        rate = f"{(len(topic) - 1) / span_s:.1f}" if span_s else ""
        topics.add_row(topic.name, str(len(topic)), rate, topic.type_name)
    console.print(topics)


@command.command()
@click.argument("bag", type=click.Path(path_type=Path))
def check(bag: Path) -> None:
    """List everything that is missing in BAG; fails if anything is missing."""
    findings = [f"{finding.place}: {finding.text}" for finding in check_bag(bag)]
    findings += metadata_findings(bag_files(bag)[0].parent, _counts(read_messages(bag, allow_truncated=True)))
    for text in findings:
        click.echo(text)
    if not findings:
        click.echo(f"{bag}: complete")
    sys.exit(FAILURE if findings else OK)


@command.command()
@click.argument("bag", type=click.Path(path_type=Path))
def recover(bag: Path) -> None:
    """Restore index and metadata.yaml of BAG, in place, after a crash or a full disk."""
    try:
        mended = repair_bag(bag_files(bag)[0].parent)
    except OSError as error:
        raise ConfigError(f"{bag}: cannot be written: {error.strerror}") from error
    saved = sum(topic.message_count for topic in mended.topics)
    if not saved:
        raise BagEmptyError(f"{bag}: no complete chunk was written: there is nothing to recover")
    span_s = (mended.end_ns - mended.start_ns) * 1e-9
    click.echo(f"{mended.file_name}: {saved} messages over {span_s:.3f} s are readable")


def _counts(contents: BagContents) -> dict[str, int]:
    return {name: len(topic) for name, topic in contents.topics.items()}


def _facts(bag: Path, contents: BagContents) -> list[tuple[str, str]]:
    files = bag_files(bag)
    size = sum(file.stat().st_size for file in files)
    times = [topic.log_ns for topic in contents.topics.values() if len(topic)]
    span_s = (max(int(each.max()) for each in times) - min(int(each.min()) for each in times)) * 1e-9
    facts = [
        ("file", f"{', '.join(map(str, files))}, {size / 1e6:.2f} MB"),
        ("ends", "with its footer" if contents.complete else "incomplete; repair it with: feedopt bag recover"),
        ("messages", f"{sum(_counts(contents).values())} over {span_s:.3f} s"),
    ]
    records = contents.metadata
    program = records.get("feedopt/program", {})
    if program:
        facts.append(("program", f"{program.get('name', '')}, sha256 {program.get('sha256', '')[:12]}..."))
    if records.get("feedopt/parameters"):
        facts.append(("parameters of", ", ".join(records["feedopt/parameters"])))
    versions = records.get("feedopt/versions", {})
    facts.append(("recorded by", ", ".join(f"{name} {value}" for name, value in versions.items()) or "others"))
    try:
        recorder = json.loads(records["feedopt/recorder"]["summary"])
        state = "complete" if recorder["complete"] else "with gaps"
        facts.append(("recorder", f"{state}, {100.0 * recorder['cpu_share_ratio']:.1f} % of a core"))
    except (KeyError, ValueError, TypeError):
        facts.append(("recorder", "no summary"))
    return facts
