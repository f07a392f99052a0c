"""G and M codes: which exclude each other in one line, and why some are refused."""

from __future__ import annotations

from enum import IntEnum

from feedopt_core.programs.gcode.words import Word, Words


class GCode(IntEnum):
    """The G codes that are read; values in tenths, so that G92.1 is 921."""

    G0 = 0
    G1 = 10
    G2 = 20
    G3 = 30
    G4 = 40
    G5 = 50
    G5_1 = 51
    G5_2 = 52
    G5_3 = 53
    G17 = 170
    G18 = 180
    G19 = 190
    G20 = 200
    G21 = 210
    G40 = 400
    G43 = 430
    G49 = 490
    G53 = 530
    G54 = 540
    G61 = 610
    G61_1 = 611
    G64 = 640
    G80 = 800
    G90 = 900
    G90_1 = 901
    G91 = 910
    G91_1 = 911
    G92 = 920
    G92_1 = 921
    G92_2 = 922
    G92_3 = 923
    G93 = 930
    G94 = 940


_G_GROUPS: dict[str, tuple[GCode, ...]] = {
    "motion": (
        GCode.G0,
        GCode.G1,
        GCode.G2,
        GCode.G3,
        GCode.G5,
        GCode.G5_1,
        GCode.G5_2,
        GCode.G5_3,
        GCode.G80,
    ),
    "dwell and offset": (
        GCode.G4,
        GCode.G53,
        GCode.G92,
        GCode.G92_1,
        GCode.G92_2,
        GCode.G92_3,
    ),
    "plane": (
        GCode.G17,
        GCode.G18,
        GCode.G19,
    ),
    "distance": (
        GCode.G90,
        GCode.G91,
    ),
    "arc distance": (
        GCode.G90_1,
        GCode.G91_1,
    ),
    "feed": (
        GCode.G93,
        GCode.G94,
    ),
    "unit": (
        GCode.G20,
        GCode.G21,
    ),
    "cutter": (GCode.G40,),
    "tool length": (
        GCode.G43,
        GCode.G49,
    ),
    "coordinate system": (GCode.G54,),
    "path": (
        GCode.G61,
        GCode.G61_1,
        GCode.G64,
    ),
}
_GROUP_OF_G: dict[int, str] = {code: group for group, codes in _G_GROUPS.items() for code in codes}
_GROUP_OF_M = {
    **dict.fromkeys((0, 1, 2, 30), "stop"),
    6: "tool",
    **dict.fromkeys((3, 4, 5), "spindle"),
    **dict.fromkeys((7, 8), "coolant"),
    9: "coolant off",
    **dict.fromkeys((48, 49), "override"),
}
_REFUSED_G: dict[int, str] = {
    **dict.fromkeys((330, 331), "spindle-synchronised motion is not supported"),
    **dict.fromkeys((382, 383, 384, 385), "probing is not supported"),
    **dict.fromkeys((410, 411, 420, 421), "cutter compensation is not supported; let the CAM system offset the path"),
    **dict.fromkeys((280, 300), "the reference position is not known here; move there with G0"),
    100: "stored offsets are not supported; use G92",
    **dict.fromkeys(
        (550, 560, 570, 580, 590, 591, 592, 593), "no offsets are stored here; only G54, without any, is accepted"
    ),
    **dict.fromkeys((730, 760, *range(810, 900, 10)), "canned cycles are not supported; expand them in the CAM system"),
    950: "feed per revolution is not supported; use G94 or G93",
    **dict.fromkeys((960,), "constant surface speed is not supported"),
}


def codes_of(words: Words) -> tuple[dict[str, GCode], dict[str, Word]]:
    """G codes and M words of a line, each by the group whose codes exclude each other.

    Raises:
        ToolpathError: a code that is not supported, or two of one group.
    """
    g_codes: dict[str, GCode] = {}
    m_words: dict[str, Word] = {}
    for word in words.codes:
        if word.letter == "g":
            code = _tenths(words, word)
            group = _GROUP_OF_G.get(code)
            if group is None:
                reason = _REFUSED_G.get(code, "this code is not supported")
                raise words.line.error(f"{word.text}: {reason}", word.index)
            if group in g_codes:
                raise words.line.error(f"{word.text} and another code for {group} in one line", word.index)
            g_codes[group] = GCode(code)
        else:
            group = _GROUP_OF_M.get(round(word.value)) if word.value == round(word.value) else None
            if group is None:
                raise words.line.error(f"{word.text}: this code is not supported", word.index)
            if group in m_words:
                raise words.line.error(f"{word.text} and another code for {group} in one line", word.index)
            m_words[group] = word
    return g_codes, m_words


def _tenths(words: Words, word: Word) -> int:
    tenths = 10.0 * word.value
    if abs(tenths - round(tenths)) > 1e-6:
        raise words.line.error(f"{word.text}: this code is not supported", word.index)
    return round(tenths)
