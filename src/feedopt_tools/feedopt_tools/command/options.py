"""Options of more than one command."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

import click

from feedopt_core.config_files import config_directory
from feedopt_core.errors import ConfigError
from feedopt_core.planner.stream_planner import PlannerParameters
from feedopt_core.programs.layers.transitions import TransitionSide
from feedopt_core.smoothing.cubic_spline import DEFAULT_TOLERANCE_MM
from feedopt_node.parameters import load_parameters
from feedopt_tools.command.workspace import workspace_root

DEFAULT_MACHINE = "router_simulation"
F = TypeVar("F", bound=Callable[..., Any])


def machine_option(function: F) -> F:
    """``--machine``: a machine file, or its name in config/machines."""
    text = "Machine file, or its name in config/machines."
    option = click.option("--machine", default=DEFAULT_MACHINE, show_default=True, metavar="FILE|NAME", help=text)
    return option(function)


def method_option(function: F) -> F:
    """``--method``: the planning method."""
    text = "Planning method; default: the one in config/nodes/planner.yaml."
    return click.option("--method", default="", metavar="NAME", help=text)(function)


def tolerance_option(function: F) -> F:
    """``--tolerance-mm``: the smoothing tolerance."""
    text = "Largest distance between smoothed and programmed path (a points program is followed exactly)."
    return click.option(
        "--tolerance-mm",
        type=click.FloatRange(min=0.0, min_open=True),
        default=DEFAULT_TOLERANCE_MM,
        show_default=True,
        help=text,
    )(function)


def transition_options(function: F) -> F:
    """``--transition-reach-mm`` and ``--transition-side``: see :meth:`LayerTransitions.requested`."""
    side = click.option(
        "--transition-side",
        type=click.Choice([side.value for side in TransitionSide]),
        default=TransitionSide.OUTSIDE.value,
        show_default=True,
        help="Side of the contours for the layer transitions.",
    )
    reach = click.option(
        "--transition-reach-mm",
        type=click.FloatRange(min=0.0),
        default=0.0,
        metavar="MM",
        help="Replace the moves between layers of closed contours by smooth curves of this lateral reach; 0: off.",
    )
    return reach(side(function))


def planner_parameters(method: str) -> PlannerParameters:
    """Parameters of config/nodes/planner.yaml; ``method``, if not empty, replaces the planning method.

    Raises:
        ConfigError: the file or the method cannot be used.
    """
    from dataclasses import replace

    from feedopt_core.planner.methods import METHOD_NAMES

    if method and method not in METHOD_NAMES:
        raise ConfigError(f"method {method!r} is unknown; available: {', '.join(METHOD_NAMES)}")
    path = config_directory() / "nodes" / "planner.yaml"
    parameters = load_parameters(PlannerParameters, path, "planner", beside=("seconds_ahead",))
    return replace(parameters, method=method) if method else parameters


def run_directory(directory: Path | None, name: str) -> Path:
    """Folder of a run: the given one, or a new one below ``runs/``.

    Raises:
        ConfigError: the folder is not empty.
    """
    if directory is None:
        directory = workspace_root() / "runs" / f"{datetime.now(tz=UTC):%Y%m%d_%H%M%S}_{Path(name).stem}"
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise ConfigError(f"{directory}: is not an empty folder; give one that does not exist yet with --out")
    return directory
