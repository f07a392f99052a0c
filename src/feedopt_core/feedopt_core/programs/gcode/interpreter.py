"""Executes the words of a line, in the order of LinuxCNC."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.geometry.nurbs import NurbsCurve
from feedopt_core.programs.gcode.arcs import read_arc
from feedopt_core.programs.gcode.codes import GCode, codes_of
from feedopt_core.programs.gcode.modal_state import MM_PER_INCH, ModalState, Plane
from feedopt_core.programs.gcode.move_buffer import MoveBuffer
from feedopt_core.programs.gcode.plain_lines import MAX_COORDINATE_MM
from feedopt_core.programs.gcode.splines import NurbsBlock, read_cubic, read_quadratic
from feedopt_core.programs.gcode.words import Word, Words
from feedopt_core.programs.moves import NurbsMove, PathMode, ProgramEvent

_AXES = "xyz"
_PLANES = {GCode.G17: Plane.XY, GCode.G18: Plane.ZX, GCode.G19: Plane.YZ}
_LENGTH_POINTS = 400


class Interpreter:
    """Executes the words of one line after the other.

    Args:
        state: changed by every line.
        buffer: takes the moves.

    Attributes:
        ended: the program has come to M2, M30 or the like.
    """

    def __init__(self, state: ModalState, buffer: MoveBuffer) -> None:
        self.state = state
        self.ended = False
        self._buffer = buffer
        self._block: NurbsBlock | None = None

    @property
    def plain(self) -> bool:
        """Lines with only G0, G1 and coordinates can be read by the scanner of plain lines."""
        return self.state.absolute and not self.state.inverse_time and self._block is None

    def execute(self, words: Words) -> None:
        """Execute one line. Raises ToolpathError, see :func:`~.reader.read_gcode`."""
        g_codes, m_words = codes_of(words)
        if self._block is not None:
            self._continue_block(self._block, words, g_codes, m_words)
            return
        state = self.state
        if "feed" in g_codes:
            state.inverse_time = g_codes["feed"] is GCode.G93
        feed = words.take("f")
        if feed is not None and feed <= 0.0:
            raise words.error(f"the feed is {feed:g}, must be above zero", "f")
        if feed is not None and not state.inverse_time:
            state.feed_mm_s = feed * state.unit_mm / 60.0
        self._events(words, m_words)
        self._settings(words, g_codes)
        self._offsets(words, g_codes.get("dwell and offset"))
        if "motion" in g_codes:
            state.motion = None if g_codes["motion"] is GCode.G80 else g_codes["motion"]
        self._motion(words, g_codes, feed)
        words.refuse_unused()
        stop = m_words.get("stop")
        if stop is not None:
            self.ended = stop.value in (2.0, 30.0)
            self._event(stop.text, words, stop=not self.ended, end=self.ended)

    def unfinished(self) -> bool:
        """A NURBS block is open."""
        return self._block is not None

    def _events(self, words: Words, m_words: dict[str, Word]) -> None:
        """Spindle, coolant, tool: what happens before the motion of the line."""
        speed, tool = words.take_word("s"), words.take_word("t")
        spindle = m_words.get("spindle")
        texts = [word.text for word in (tool,) if word is not None]
        if spindle is not None or speed is not None:
            texts.append(" ".join(word.text for word in (spindle, speed) if word is not None))
        texts += [m_words[group].text for group in ("coolant", "coolant off", "override") if group in m_words]
        for text in texts:
            self._event(text, words)
        if "tool" in m_words:
            self._event(m_words["tool"].text, words, stop=True)

    def _settings(self, words: Words, g_codes: dict[str, GCode]) -> None:
        state = self.state
        state.plane = _PLANES[g_codes["plane"]] if "plane" in g_codes else state.plane
        if "unit" in g_codes:
            state.unit_mm = MM_PER_INCH if g_codes["unit"] is GCode.G20 else 1.0
        if g_codes.get("tool length") is GCode.G43:
            # Tool lengths are not known here: the event records where G43 takes effect.
            offset = words.take_word("h")
            self._event("G43" if offset is None else f"G43 {offset.text}", words)
        if "distance" in g_codes:
            state.absolute = g_codes["distance"] is GCode.G90
        if "arc distance" in g_codes:
            state.absolute_centres = g_codes["arc distance"] is GCode.G90_1
        path = g_codes.get("path")
        if path is GCode.G64:
            tolerance, naive = words.take("p"), words.take("q")
            if min(tolerance or 0.0, naive or 0.0) < 0.0:
                raise words.error("a tolerance below zero", "pq")
            tolerance_mm = None if not tolerance else tolerance * state.unit_mm
            state.mode = PathMode(tolerance_mm=tolerance_mm, naive_cam_mm=(naive or 0.0) * state.unit_mm)
        elif path is not None:
            state.mode = PathMode(exact_stop=True)

    def _offsets(self, words: Words, code: GCode | None) -> None:
        state = self.state
        if code is GCode.G4:
            dwell_s = words.need("p", "G4")
            if dwell_s < 0.0:
                raise words.error(f"the dwell is {dwell_s:g} s, must not be below zero", "p")
            self._event(f"G4 P{dwell_s:.12g}", words, stop=True, dwell_s=dwell_s)
        elif code is GCode.G92:
            if not words.has(_AXES):
                raise words.error("G92 needs a coordinate")
            for axis, letter in enumerate(_AXES):
                value = words.take(letter)
                if value is not None:
                    state.offset_mm[axis] = state.position_mm[axis] - value * state.unit_mm
            state.stored_offset_mm = state.offset_mm.copy()
        elif code in (GCode.G92_1, GCode.G92_2):
            state.offset_mm = np.zeros(3)
            if code is GCode.G92_1:
                state.stored_offset_mm = np.zeros(3)
        elif code is GCode.G92_3:
            state.offset_mm = state.stored_offset_mm.copy()

    def _motion(self, words: Words, g_codes: dict[str, GCode], feed: float | None) -> None:
        state, machine = self.state, g_codes.get("dwell and offset") is GCode.G53
        if g_codes.get("dwell and offset") is GCode.G92:
            if "motion" in g_codes:
                raise words.error("G92 and a motion both want the coordinates; give them lines of their own", _AXES)
            return
        if g_codes.get("motion") is GCode.G5_2:
            self._need_feed(words, feed)
            self._block = NurbsBlock(words, state)
            self._block.add(words, state)
            return
        if g_codes.get("motion") is GCode.G5_3:
            raise words.error("G5.3 without a G5.2 before it")
        explicit = "motion" in g_codes and state.motion is not None
        if not words.has(_AXES) and not (explicit and state.motion in (GCode.G2, GCode.G3) and words.has("ijk")):
            return
        if state.motion is None:
            raise words.error("coordinates without a motion code: say G0, G1, G2 or G3", _AXES)
        if machine and state.motion not in (GCode.G0, GCode.G1):
            raise words.error("G53 goes with G0 and G1 only")
        end_mm = self._end(words, machine)
        if state.motion is GCode.G0:
            self._straight(words, end_mm, math.inf)
            return
        self._need_feed(words, feed)
        if state.motion is GCode.G1:
            length_mm = float(np.linalg.norm(end_mm - state.position_mm))
            self._straight(words, end_mm, self._feed(length_mm, feed))
        elif state.motion in (GCode.G2, GCode.G3):
            arc, length_mm = read_arc(words, state, end_mm, state.motion is GCode.G2)
            self._buffer.add(replace(arc, feed_mm_s=self._feed(length_mm, feed)))
            # The scanner moves the position in place.
            state.position_mm = end_mm.copy()
        else:
            curve = (read_cubic if state.motion is GCode.G5 else read_quadratic)(words, state, end_mm)
            self._spline(curve, feed)

    def _continue_block(
        self, block: NurbsBlock, words: Words, g_codes: dict[str, GCode], m_words: dict[str, Word]
    ) -> None:
        if m_words or g_codes.keys() - {"motion"} or g_codes.get("motion", GCode.G5_3) is not GCode.G5_3:
            raise words.error("between G5.2 and G5.3 there are control points only")
        if g_codes:
            self._block = None
            words.refuse_unused()
            self._spline(block.finish(words, self.state), None)
            self.state.motion = None
        else:
            block.add(words, self.state)
            words.refuse_unused()

    def _spline(self, curve: NurbsMove, feed: float | None) -> None:
        if self.state.inverse_time:
            shape = NurbsCurve.from_control_net(
                curve.degree, curve.knots, curve.control_points_mm, curve.weights
            ).evaluate(np.linspace(curve.knots[0], curve.knots[-1], _LENGTH_POINTS))[0]
            length_mm = float(np.sum(np.linalg.norm(np.diff(shape, axis=0), axis=1)))
            curve = replace(curve, feed_mm_s=self._feed(length_mm, feed))
        self._buffer.add(curve)
        self.state.position_mm = curve.control_points_mm[-1].copy()

    def _end(self, words: Words, machine: bool) -> FloatArray:
        """Where a motion ends; coordinates that are not named stay."""
        state, end_mm = self.state, self.state.position_mm.copy()
        for axis, letter in enumerate(_AXES):
            value = words.take(letter)
            if value is None:
                continue
            if machine:
                end_mm[axis] = value * state.unit_mm
            elif state.absolute:
                end_mm[axis] = value * state.unit_mm + state.offset_mm[axis]
            else:
                end_mm[axis] += value * state.unit_mm
            if not abs(end_mm[axis]) <= MAX_COORDINATE_MM:
                raise words.error(f"{letter.upper()} leads to {end_mm[axis]:g} mm; no machine reaches that far", letter)
        return end_mm

    def _straight(self, words: Words, end_mm: FloatArray, feed_mm_s: float) -> None:
        if np.any(end_mm != self.state.position_mm):
            self._buffer.straight(self.state.position_mm, end_mm, words.line.number, feed_mm_s, self.state.mode)
            self.state.position_mm = end_mm

    def _need_feed(self, words: Words, feed: float | None) -> None:
        if self.state.inverse_time:
            if feed is None:
                raise words.error("with G93 every line with a feed motion needs its own F")
        elif math.isnan(self.state.feed_mm_s):
            raise words.error("a feed motion without a feed; set one with F")

    def _feed(self, length_mm: float, feed: float | None) -> float:
        """Feed of a motion: the modal feed, or with G93 the feed at which the motion takes 1/F minutes."""
        if self.state.inverse_time and feed is not None:
            return length_mm * feed / 60.0
        return self.state.feed_mm_s

    def _event(self, text: str, words: Words, *, stop: bool = False, dwell_s: float = 0.0, end: bool = False) -> None:
        self._buffer.add(ProgramEvent(text, words.line.number, stop, dwell_s, end))
