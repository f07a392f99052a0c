"""Passes a run of short moves through the run smoother and turns its pieces into path elements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from feedopt_core.arrays import FloatArray, IntArray
from feedopt_core.errors import ToolpathError
from feedopt_core.geometry.segments import NurbsSegment
from feedopt_core.smoothing.path_element import AVAILABLE_SHARE, UNPLACED, PathElement, rounding_mm, straight_element
from feedopt_core.smoothing.runs.smoother import RunPiece, RunSmoother

_TUBE_SHARE = 0.98
_REFERENCE_POINTS = 512


class Run:
    """One run: points in, elements out.

    Moves so wild that no smooth curve stands for them (a program's noise as large as the tolerance) are given as what
    they are, straight elements, as long as no piece of the curve has been given yet.

    Args:
        tolerance_mm: largest distance from the moves.
        rapid: the moves are rapids.
        start_mm: where it starts, shape (dimensions,).
        direction: of the straight element before it; None if it starts at a corner.
    """

    def __init__(self, tolerance_mm: float, rapid: bool, start_mm: FloatArray, direction: FloatArray | None) -> None:
        self._tolerance_mm = tolerance_mm
        self._rapid = rapid
        self._follows = direction is not None
        self._smoother: RunSmoother | None = RunSmoother(_TUBE_SHARE * tolerance_mm, direction)
        self._head = self._tail = start_mm[None, :]
        self._held: PathElement | None = None
        # All input of the smoother, until its first piece comes.
        self._given = [(start_mm[None, :], np.zeros(1, dtype=np.int64), np.zeros(1))]
        self._begun = False

    def add(self, points_mm: FloatArray, lines: IntArray, feed_mm_s: FloatArray) -> Iterator[PathElement]:
        """Add moves to the points, shape (n, dimensions); yields the path elements that are final now."""
        if self._smoother is None:
            yield from self._straight_elements(points_mm, lines, feed_mm_s)
            return
        if len(self._head) < _REFERENCE_POINTS:
            self._head = np.concatenate([self._head, points_mm])[:_REFERENCE_POINTS]
        self._tail = np.concatenate([self._tail, points_mm])[-_REFERENCE_POINTS:]
        if self._begun:
            yield from self._elements(self._smoother.add(points_mm, lines, feed_mm_s))
            return
        self._given.append((points_mm, lines, feed_mm_s))
        first = self._given if len(self._given) == 2 else self._given[-1:]
        try:
            pieces = self._smoother.add(*_joined(first))
        except ToolpathError:
            yield from self._give_up()
        else:
            yield from self._elements(pieces)

    def finish(self, direction: FloatArray | None) -> Iterator[PathElement]:
        """Yield the remaining elements. ``direction``: of the straight element after it, None at a corner."""
        if self._smoother is None:
            return
        try:
            pieces = self._smoother.finish(direction)
        except ToolpathError:
            if self._begun:
                raise
            yield from self._give_up()
            return
        yield from self._elements(pieces)
        if self._held is not None:
            available_mm = min(AVAILABLE_SHARE * self._held.length_mm, 0.9 * _length(self._tail))
            yield replace(self._held, available_end_mm=available_mm, programmed_end_mm=self._tail)
        self._held = None

    def _elements(self, pieces: list[RunPiece]) -> Iterator[PathElement]:
        for piece in pieces:
            self._begun = True
            self._given.clear()
            if self._held is not None:
                yield self._held
            curve = NurbsSegment(UNPLACED, piece.curve, piece.arc_length_map)
            element = PathElement(
                curve, piece.line, piece.feed_mm_s, self._tolerance_mm, self._rapid, follows=self._follows
            )
            if not self._follows:
                available_mm = min(AVAILABLE_SHARE * curve.length_mm, 0.9 * _length(self._head))
                element = replace(element, available_start_mm=available_mm, programmed_start_mm=self._head)
            self._held, self._follows = element, True

    def _give_up(self) -> Iterator[PathElement]:
        """Fall back to straight elements for all moves of this run."""
        self._smoother = None
        points_mm, lines, feed_mm_s = _joined(self._given)
        self._tail = points_mm[:1]
        self._given.clear()
        yield from self._straight_elements(points_mm[1:], lines[1:], feed_mm_s[1:])

    def _straight_elements(
        self, points_mm: FloatArray, lines: IntArray, feed_mm_s: FloatArray
    ) -> Iterator[PathElement]:
        at_mm, least_mm = self._tail[-1], rounding_mm(points_mm)
        for end_mm, line, feed in zip(points_mm, lines, feed_mm_s, strict=True):
            if np.linalg.norm(end_mm - at_mm) > least_mm:
                yield straight_element(at_mm, end_mm, int(line), float(feed), self._tolerance_mm, self._rapid)
                at_mm = end_mm
        self._tail = at_mm[None, :]


def _joined(
    blocks: list[tuple[FloatArray, IntArray, FloatArray]],
) -> tuple[FloatArray, IntArray, FloatArray]:
    points, lines, feeds = zip(*blocks, strict=True)
    return np.concatenate(points), np.concatenate(lines), np.concatenate(feeds)


def _length(points_mm: FloatArray) -> float:
    return float(np.sum(np.linalg.norm(np.diff(points_mm, axis=0), axis=1)))
