"""The pages of a run, each with its title and the colouring of the path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from feedopt_tools.errors import ViewError

if TYPE_CHECKING:
    from feedopt_tools.views.signals.scene import RunScene

OVER = ("time", "arc-length")


@dataclass(frozen=True)
class Page:
    """One page.

    Attributes:
        key: name of the page on the command line, and file name of its picture.
        title: title of its tab.
        path: colouring of the path shown first: key of a path colouring, or ``contour``.
        over: horizontal axis of its curves: ``time`` or ``arc-length``.
    """

    key: str
    title: str
    path: str
    over: str = "time"


MOTION = Page("motion", "Motion", "feed")
ACTIVE_LIMIT = Page("active-limit", "Active limit", "limit", "arc-length")
AXIS_LIMITS = Page("axis-limits", "Axis limits", "use")
TRACKING = Page("tracking", "Tracking", "error")
CONTOUR = Page("contour", "Contour", "contour", "arc-length")
PLANNER = Page("planner", "Planner", "feed")
EVENTS = Page("events", "Events", "control")
AXIS_QUANTITIES = ("velocity", "acceleration", "jerk")
TRACKING_QUANTITIES = ("velocity", "tracking_error", "control_signal")
PAGES = (MOTION, ACTIVE_LIMIT, AXIS_LIMITS, TRACKING, CONTOUR, PLANNER, EVENTS)


def page_named(key: str) -> Page:
    """Page by its key. Raises ViewError."""
    for page in PAGES:
        if page.key == key:
            return page
    raise ViewError(f"there is no page {key!r}; available: {', '.join(page.key for page in PAGES)}")


def pages_of(scene: RunScene) -> tuple[Page, ...]:
    """The pages for which a run holds data, in the order of :data:`PAGES`."""
    quantities = scene.signals.quantities
    shown = {
        MOTION: True,
        ACTIVE_LIMIT: bool(scene.limit_use.limits),
        AXIS_LIMITS: True,
        TRACKING: quantities["tracking_error"].drawn or quantities["control_signal"].drawn,
        CONTOUR: scene.contour is not None,
        PLANNER: bool(scene.signals.run.chunks),
        EVENTS: True,
    }
    return tuple(page for page in PAGES if shown[page])
