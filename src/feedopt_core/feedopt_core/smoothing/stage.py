"""The smoothing stage: programmed moves in, segments of a smooth path out, as a stream.

Moves become path elements (smooth pieces between joints). Then every joint between two elements is resolved in turn:

- the elements continue each other: nothing to do
- corner between straight elements: pair of Euler spirals
- any other joint: both elements are cut back and joined by a quintic
- no curve within the tolerance (reversal, cusp, short elements), or a programmed exact stop: the machine stops there
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import PlanarSegment, Segment, SegmentPlace
from feedopt_core.programs.moves import Move, ProgramEvent
from feedopt_core.smoothing.corners.blend import SMOOTH_TURN_RAD, blend, continues
from feedopt_core.smoothing.corners.euler_pair import EulerPair, turning_angle
from feedopt_core.smoothing.path_element import PathElement, part, rounding_mm
from feedopt_core.smoothing.path_element_reader import PathElementReader

_SHARPEST_CORNER_RAD = 2.97
"""170 degrees: at sharper corners the spirals are so tight that an exact stop is as fast."""
_BRIDGED = 4.0
"""Path elements shorter than this, in tolerances, cannot have a blend at each end: one blend replaces them."""
_LONGEST_BRIDGE = 12.0


def smooth(
    moves: Iterator[Move], tolerance_mm: float, dimensions: int, rapid_tolerance_mm: float | None = None
) -> Iterator[Segment]:
    """Segments of the smoothed path, G2 everywhere but at exact stops, in order, as soon as they are final.

    Events after the last motion have no segment and are lost.

    Args:
        moves: of the program.
        tolerance_mm: largest distance of the smoothed from the programmed path, if the program gives none.
        dimensions: coordinates of the machine, 2 or 3.
        rapid_tolerance_mm: the same for joints between rapids; None: as for feed moves. Where a rapid meets a feed
            move, the smaller one of the two holds.

    Raises:
        ToolpathError: a move needs a coordinate that the machine lacks, does not start where the one before ended, or
            has no curve; there is no motion at all. Names the line.
    """
    reader = PathElementReader(tolerance_mm, dimensions, rapid_tolerance_mm)
    stream = SegmentStream()
    for move in moves:
        if isinstance(move, ProgramEvent):
            yield from stream.take_all(reader.flush())
            stream.take_event(move)
            if move.end:
                break
        else:
            yield from stream.take_all(reader.take(move))
    yield from stream.take_all(reader.flush())
    yield from stream.finish()


class SegmentStream:
    """Path elements in, segments out. It holds one element, and one segment whose end is not decided yet."""

    def __init__(self) -> None:
        self._element: PathElement | None = None
        self._cut_mm = 0.0
        self._bridge: list[PathElement] = []
        self._events: list[str] = []
        self._due: list[str] = []
        self._stop = False
        self._dwell_s = 0.0
        self._held: Segment | None = None

    def take_event(self, event: ProgramEvent) -> None:
        """Add an event after the last element; its text goes to the segment that starts there."""
        if event.text:
            self._events.append(event.text)
        self._stop = self._stop or event.stop or event.dwell_s > 0.0
        self._dwell_s += event.dwell_s

    def take_all(self, elements: Iterator[PathElement]) -> Iterator[Segment]:
        """Add elements; yields the segments that are final now."""
        for element in elements:
            yield from self._take(element)

    def finish(self) -> Iterator[Segment]:
        """Yield the remaining segments; the last one ends the program. Raises ToolpathError if there is no motion."""
        if self._element is None:
            raise ToolpathError("holds no motion", line=1, column=1)
        yield from self._settle_bridge()
        yield from self._leave(self._element.length_mm)
        assert self._held is not None
        yield replace(self._held, place=replace(self._held.place, last=True))

    def _take(self, element: PathElement) -> Iterator[Segment]:
        before = self._bridge[-1] if self._bridge else self._element
        if before is None:
            self._due, self._events, self._stop, self._dwell_s = self._events, [], False, 0.0
            self._element = element
            return
        stops = self._stop or before.exact_stop
        tiny = element.length_mm < _BRIDGED * element.tolerance_mm and not (
            stops or element.exact_stop or element.follows
        )
        available_mm = _LONGEST_BRIDGE * element.tolerance_mm - sum(held.length_mm for held in self._bridge)
        if tiny and element.length_mm <= available_mm:
            self._bridge.append(element)
            return
        if stops or element.follows or tiny:
            yield from self._settle_bridge()
        yield from self._resolve(element)

    def _settle_bridge(self) -> Iterator[Segment]:
        """Resolve the joints of the tiny elements one by one, since no blend spans them."""
        bridge, self._bridge = self._bridge, []
        events, stop, dwell_s = self._events, self._stop, self._dwell_s
        self._events, self._stop, self._dwell_s = [], False, 0.0
        for element in bridge:
            yield from self._resolve(element)
        self._events, self._stop, self._dwell_s = events, stop, dwell_s

    def _resolve(self, after: PathElement) -> Iterator[Segment]:
        """Resolve the joint between the element held and the next one, and hold the next one."""
        before, bridge = self._element, self._bridge
        assert before is not None
        if self._stop or before.exact_stop:
            yield from self._stop_before(after)
        elif not bridge and after.follows:
            yield from self._go_on(after)
        elif not bridge and before.straight and after.straight:
            yield from self._corner(before, after)
        elif not bridge and continues(before.curve, after.curve):
            yield from self._go_on(after)
        else:
            found = blend(before, bridge, after)
            if found is not None:
                self._bridge = []
                yield from self._leave(before.length_mm - found.cut_before_mm)
                yield from self._place(found.curve, before, *bridge, after)
                self._hold(after, found.cut_after_mm)
            elif bridge:
                yield from self._settle_bridge()
                yield from self._resolve(after)
            else:
                yield from self._stop_before(after)

    def _corner(self, before: PathElement, after: PathElement) -> Iterator[Segment]:
        assert isinstance(before.curve, PlanarSegment) and isinstance(after.curve, PlanarSegment)
        directions = before.curve.tangent, after.curve.tangent
        angle = turning_angle(*directions)
        available_mm = min(before.available_end_mm, after.available_start_mm)
        corner_mm = after.curve.start_mm
        if angle <= SMOOTH_TURN_RAD:
            yield from self._go_on(after)
            return
        if angle > _SHARPEST_CORNER_RAD or available_mm <= 1e3 * rounding_mm(corner_mm):
            yield from self._stop_before(after)
            return
        pair = EulerPair.turning(angle)
        length_mm = pair.length_mm(min(before.tolerance_mm, after.tolerance_mm), available_mm)
        first, second = pair.curves(corner_mm, *directions, length_mm)
        cut_mm = pair.cut * length_mm
        yield from self._leave(before.length_mm - cut_mm)
        yield from self._place(first, before, after)
        self._due, self._events = self._events, []
        yield from self._place(second, before, after)
        self._hold(after, cut_mm)

    def _go_on(self, after: PathElement) -> Iterator[Segment]:
        """Join elements that continue each other."""
        assert self._element is not None
        yield from self._leave(self._element.length_mm)
        self._hold(after, 0.0)

    def _stop_before(self, after: PathElement) -> Iterator[Segment]:
        assert self._element is not None
        yield from self._leave(self._element.length_mm)
        assert self._held is not None
        place = replace(self._held.place, exact_stop=True, dwell_s=self._held.place.dwell_s + self._dwell_s)
        self._held = replace(self._held, place=place)
        self._hold(after, 0.0)

    def _hold(self, element: PathElement, cut_mm: float) -> None:
        self._element, self._cut_mm = element, cut_mm
        self._due, self._events = [*self._due, *self._events], []
        self._stop, self._dwell_s = False, 0.0

    def _leave(self, end_mm: float) -> Iterator[Segment]:
        """Yield the remaining part of the element held, up to an arc length on its curve."""
        element = self._element
        assert element is not None
        yield from self._place(part(element.curve, self._cut_mm, end_mm), element)

    def _place(self, curve: Segment, *elements: PathElement) -> Iterator[Segment]:
        """Append the next curve with the lower feed of its elements; it is a rapid only if all of them are."""
        before = self._held
        place = SegmentPlace(
            sequence=1 if before is None else before.place.sequence + 1,
            source_line=elements[0].line,
            s_start_mm=0.0 if before is None else before.place.s_start_mm + before.length_mm,
            feed_limit_mm_s=min(element.feed_mm_s for element in elements),
            rapid=all(element.rapid for element in elements),
            events=tuple(self._due),
        )
        self._due = []
        self._held = replace(curve, place=place)
        if before is not None:
            yield before
