"""Entry of the ``feedopt`` command. Sub-commands are imported when they run, so that the help appears at once."""

from __future__ import annotations

import importlib
import os
import sys

import click

_COMMANDS = {
    "demo": ("graph", "Run, record and draw the fan contour."),
    "run": ("graph", "Execute and record a program in real time."),
    "plan": ("program", "Plan a program without ROS."),
    "toolpath": ("program", "List the content of a program and show its smoothed path."),
    "view": ("recording", "Show a recorded run, or compare two."),
    "live": ("graph", "Draw the running graph."),
    "report": ("recording", "Write an HTML page about a recorded run."),
    "export": ("program", "Write a plan or a run for other tools."),
    "replay": ("recording", "Run recorded inputs again and compare the outputs."),
    "bag": ("recording", "Show, check and repair recordings."),
    "test": ("upkeep", "Check the workspace."),
    "doctor": ("upkeep", "List what is missing on this computer."),
    "bench": ("upkeep", "Run a benchmark."),
}
"""Folder of each command, and its line of help."""
_EPILOG = (
    "Exit codes: 0 success, 1 failure, 2 invalid program, machine or option, 3 another graph runs on this ROS domain."
)


class LazyGroup(click.Group):
    """A command group that lists its commands without importing them."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands in the order of the help."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command; for the list of commands only its name and help line."""
        if cmd_name not in _COMMANDS:
            return None
        if ctx.resilient_parsing or not ctx.meta.get("feedopt.resolving"):
            return click.Command(cmd_name, help=_COMMANDS[cmd_name][1])
        from feedopt_node.graph import ONE_THREAD

        # Linear algebra reads these variables during its import below.
        os.environ.update(ONE_THREAD)
        module = importlib.import_module(f"feedopt_tools.command.{_COMMANDS[cmd_name][0]}.{cmd_name}")
        found = module.command
        assert isinstance(found, click.Command)
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Import the command to run."""
        ctx.meta["feedopt.resolving"] = True
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """Turn expected errors and missing extras into one message and an exit code."""
        from feedopt_core.errors import FeedoptError

        try:
            return super().invoke(ctx)
        except FeedoptError as error:
            from feedopt_tools.command.exit_codes import exit_code

            click.echo(f"feedopt: {error}", err=True)
            sys.exit(exit_code(error.kind))
        except ModuleNotFoundError as error:
            from feedopt_tools.command.exit_codes import UNUSABLE_INPUT
            from feedopt_tools.command.extras import missing_extra

            text = missing_extra(error.name or "")
            if text is None:
                raise
            click.echo(f"feedopt: {text}", err=True)
            sys.exit(UNUSABLE_INPUT)


@click.group(cls=LazyGroup, epilog=_EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="feedopt_tools", prog_name="feedopt")
def main() -> None:
    """Plans feed rates along toolpaths, interpolates them at 1 kHz, and runs them on a simulated router."""


if __name__ == "__main__":
    main()
