"""G-code with the optimised feeds for existing controllers: one chord per line, with its feed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.segments import SegmentPlace
from feedopt_core.pipeline.read_program import Program, ProgramKind, read_moves
from feedopt_core.programs.moves import LineMoves
from feedopt_tools.errors import ExportError
from feedopt_tools.export.chords import chord_deviation_mm, chord_ends_mm
from feedopt_tools.export.motion import Motion

LETTERS = "XYZ"
_SECONDS_A_MINUTE = 60.0
_ENDS = ("M2", "M30")


@dataclass(frozen=True)
class GcodeSettings:
    """How a motion is written.

    Attributes:
        tolerance_mm: largest distance of a chord from the path.
        longest_chord_mm: longest chord; shorter chords follow the planned feed more closely.
        feed_step_mm_min: feeds are rounded down to multiples of it; feeds below one step are not rounded.
        inverse_time: feeds as G93 (moves per minute) instead of G94 (mm per minute).
        decimals: of coordinates.
    """

    tolerance_mm: float = 0.002
    longest_chord_mm: float = 0.5
    feed_step_mm_min: float = 1.0
    inverse_time: bool = False
    decimals: int = 4


@dataclass(frozen=True)
class Gcode:
    """A written program and the figures found by reading it back.

    Attributes:
        lines: without newlines.
        chords: number of moves.
        deviation_mm: largest distance of the path from the moves that were read back.
        planned_s: motion time without dwells.
        written_s: time at the feeds that were read back, without acceleration.
        blocks_a_second: largest number of moves per second that the controller must process.
    """

    lines: tuple[str, ...]
    chords: int
    deviation_mm: float
    planned_s: float
    written_s: float
    blocks_a_second: float


@dataclass(frozen=True)
class _Chords:
    """Chords as written: ends_mm and points_mm have n + 1 rows, the others n."""

    ends_mm: FloatArray
    points_mm: FloatArray
    times_s: FloatArray
    places: list[SegmentPlace]


def write_gcode(motion: Motion, settings: GcodeSettings) -> Gcode:
    """Write a motion as G-code, and check it by reading it back.

    Raises:
        ExportError: a setting is out of range, or the program read back differs from the motion.
    """
    for name in ("tolerance_mm", "longest_chord_mm", "feed_step_mm_min"):
        if not 0.0 < getattr(settings, name) < math.inf:
            raise ExportError(f"{name} is {getattr(settings, name):g}, must be above zero")
    chords = _chords_of(motion, settings)
    lines = tuple(_lines(motion, settings, chords))
    return _read_back(motion, settings, chords, lines)


def _chords_of(motion: Motion, settings: GcodeSettings) -> _Chords:
    resolution_mm = 0.5 * math.sqrt(motion.machine.dimensions) * 10.0**-settings.decimals
    if resolution_mm >= settings.tolerance_mm:
        raise ExportError(
            f"coordinates of {settings.decimals} decimals are off by up to {resolution_mm:g} mm, "
            f"more than the tolerance of {settings.tolerance_mm:g} mm: give more decimals or a larger tolerance"
        )
    ends = chord_ends_mm(motion.toolpath, settings.tolerance_mm - resolution_mm, settings.longest_chord_mm)
    points = np.round(motion.toolpath.evaluate(ends).r_mm, settings.decimals) + 0.0
    # Ends that round to the same point become one.
    keep = np.concatenate([[True], np.any(np.diff(points, axis=0) != 0.0, axis=1)])
    keep[-1] = True
    ends, points = ends[keep], points[keep]
    segments = motion.toolpath.segments
    starts = np.array([segment.place.s_start_mm for segment in segments])
    owner = np.clip(np.searchsorted(starts, 0.5 * (ends[:-1] + ends[1:]), side="right") - 1, 0, len(segments) - 1)
    places = [segments[i].place for i in owner.tolist()]
    return _Chords(ends, points, np.maximum(np.diff(motion.times_at(ends)), 1e-6), places)


def _lines(motion: Motion, settings: GcodeSettings, chords: _Chords) -> Iterator[str]:
    feeds = "G93, moves per minute" if settings.inverse_time else "G94, mm per minute"
    yield f"(feedopt: {_comment(motion.name)} on {_comment(motion.machine.name)})"
    yield f"(chords within {settings.tolerance_mm:g} mm of the smoothed path, at most {settings.longest_chord_mm:g} mm)"
    yield f"(planned motion time {motion.t_s[-1]:.3f} s; feeds in {feeds})"
    yield "G21 G90 G17 G93" if settings.inverse_time else "G21 G90 G17 G94"
    yield f"G0 {_words(chords.points_mm[0], None, settings.decimals)}"
    lengths = np.linalg.norm(np.diff(chords.points_mm, axis=0), axis=1)
    mode, feed, before = "", "", None
    for k, place in enumerate(chords.places):
        if before is not place:
            yield from _between(before, place)
            before = place
        words = _words(chords.points_mm[k + 1], chords.points_mm[k], settings.decimals)
        if not words:
            continue
        wanted_mode = "G0" if place.rapid else "G1"
        wanted_feed = "" if place.rapid else _feed_word(settings, float(lengths[k]), float(chords.times_s[k]))
        # An inverse-time feed holds for one move only: write it on every line.
        shown = wanted_feed if wanted_feed and (settings.inverse_time or wanted_feed != feed) else ""
        yield " ".join(filter(None, (wanted_mode if wanted_mode != mode else "", words, shown)))
        mode, feed = wanted_mode, wanted_feed or feed
    last = chords.places[-1]
    if last.dwell_s > 0.0:
        yield f"G4 P{last.dwell_s:g}"
    yield "M2"


def _between(before: SegmentPlace | None, place: SegmentPlace) -> Iterator[str]:
    """Dwell after a segment, and the words that take effect before the next one."""
    if before is not None and before.dwell_s > 0.0:
        yield f"G4 P{before.dwell_s:g}"
    for text in place.events:
        if text.upper().replace(" ", "") not in _ENDS:
            yield text


def _feed_word(settings: GcodeSettings, length_mm: float, time_s: float) -> str:
    if settings.inverse_time:
        return f"F{_SECONDS_A_MINUTE / time_s:.6g}"
    feed, step = _SECONDS_A_MINUTE * length_mm / time_s, settings.feed_step_mm_min
    # Feeds below one step are not rounded: rounding up would be faster than planned.
    return f"F{step * math.floor(feed / step):.10g}" if feed >= step else f"F{feed:.3g}"


def _words(point_mm: FloatArray, before_mm: FloatArray | None, decimals: int) -> str:
    """Words of the coordinates that change."""
    words = []
    for i, value in enumerate(point_mm.tolist()):
        if before_mm is None or value != before_mm[i]:
            words.append(f"{LETTERS[i]}{value:.{decimals}f}")
    return " ".join(words)


def _comment(text: str) -> str:
    return text.replace("(", "[").replace(")", "]")


def _read_back(motion: Motion, settings: GcodeSettings, chords: _Chords, lines: tuple[str, ...]) -> Gcode:
    """Read the written program and compare it with path and times of the motion."""
    points, feeds, rapid = list[FloatArray](), list[FloatArray](), list[FloatArray]()
    for move in read_moves(Program(ProgramKind.GCODE, lines), "the exported program"):
        if isinstance(move, LineMoves):
            points.append(move.points_mm)
            feeds.append(move.feed_mm_s)
            rapid.append(np.full(len(move.feed_mm_s), move.rapid))
    dimensions = chords.points_mm.shape[1]
    read_mm = np.vstack(points)[:, :dimensions]
    # The first move goes to the start; it is missing if the start is the origin.
    written_mm = chords.points_mm[1:]
    read_mm, feed_mm_s = read_mm[-len(written_mm) :], np.concatenate(feeds)[-len(written_mm) :]
    if read_mm.shape != written_mm.shape or not np.allclose(read_mm, written_mm, rtol=0.0, atol=1e-9):
        raise ExportError("the exported program reads back with other moves than were written; please report this")
    path_mm = np.vstack([chords.points_mm[:1], read_mm])
    deviation_mm = chord_deviation_mm(motion.toolpath, chords.ends_mm, path_mm)
    if deviation_mm > settings.tolerance_mm * (1.0 + 1e-6):
        raise ExportError(
            f"the exported chords leave the path by {deviation_mm:g} mm, more than {settings.tolerance_mm:g} mm: "
            "give a smaller longest chord"
        )
    lengths = np.linalg.norm(np.diff(path_mm, axis=0), axis=1)
    fed = ~np.concatenate(rapid)[-len(written_mm) :].astype(bool)
    written_s = np.where(fed, lengths / np.where(fed, feed_mm_s, 1.0), chords.times_s)
    return Gcode(
        lines=lines,
        chords=len(lengths),
        deviation_mm=deviation_mm,
        planned_s=float(np.sum(chords.times_s)),
        written_s=float(np.sum(written_s)),
        blocks_a_second=_most_in_a_second(written_s),
    )


def _most_in_a_second(times_s: FloatArray) -> float:
    """Largest number of moves per second, over windows of a tenth of a second."""
    ends_s = np.cumsum(times_s)
    window_s = min(0.1, float(ends_s[-1]))
    counts = np.searchsorted(ends_s, ends_s + window_s) - np.arange(len(ends_s))
    return float(np.max(counts)) / window_s
