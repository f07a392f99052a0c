"""Entry of the ``feedopt`` command. Sub-commands are imported when they run, so that help comes at once."""

from __future__ import annotations

import importlib
import os
import sys

import click

_COMMANDS = {
    "demo": ("graph", "Run, record and draw the fan contour."),
    "run": ("graph", "Execute and record a program in real time."),
    "plan": ("program", "Plan a program without ROS."),
    "toolpath": ("program", "Say what a program holds, and show its smoothed path."),
    "view": ("recording", "Show a recorded run, or two."),
    "live": ("graph", "Draw the graph while it runs."),
    "report": ("recording", "Write a page about a recorded run."),
    "export": ("program", "Write a plan or a run for other tools."),
    "replay": ("recording", "Run recorded inputs again and compare."),
    "bag": ("recording", "Look into, check and mend recordings."),
    "test": ("upkeep", "Check the workspace."),
    "doctor": ("upkeep", "Say what is missing on this machine."),
    "bench": ("upkeep", "Run a benchmark."),
}
"""Folder of each command, and its line of help."""
_EPILOG = (
    "Exit codes: 0 done, 1 failed, 2 a program, machine or option cannot be used, "
    "3 another graph runs on this ROS domain."
)


class LazyGroup(click.Group):
    """A group that knows the names of its commands, and imports one when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of their use."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command; a name and a help line alone while only the list is shown."""
        if cmd_name not in _COMMANDS:
            return None
        if ctx.resilient_parsing or not ctx.meta.get("feedopt.resolving"):
            return click.Command(cmd_name, help=_COMMANDS[cmd_name][1])
        from feedopt_node.graph import ONE_THREAD

        # Linear algebra reads these when it is imported, which is below.
        os.environ.update(ONE_THREAD)
        module = importlib.import_module(f"feedopt_tools.command.{_COMMANDS[cmd_name][0]}.{cmd_name}")
        found = module.command
        assert isinstance(found, click.Command)
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Import the command that is to run."""
        ctx.meta["feedopt.resolving"] = True
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """Errors raised on purpose, and extras that are not installed, become one message and an exit code."""
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
