"""G and M codes: which exclude each other in one line, and why some are refused."""

from __future__ import annotations

from feedopt_core.programs.gcode.words import Word, Words

_G_GROUPS: dict[str, tuple[int, ...]] = {
    "motion": (0, 10, 20, 30, 50, 51, 52, 53, 800),
    "dwell and offset": (40, 530, 920, 921, 922, 923),
    "plane": (170, 180, 190),
    "distance": (900, 910),
    "arc distance": (901, 911),
    "feed": (930, 940),
    "unit": (200, 210),
    "cutter": (400,),
    "tool length": (430, 490),
    "coordinate system": (540,),
    "path": (610, 611, 640),
}
"""Codes in tenths."""
_GROUP_OF_G = {code: group for group, codes in _G_GROUPS.items() for code in codes}
_GROUP_OF_M = {
    **dict.fromkeys((0, 1, 2, 30), "stop"),
    6: "tool",
    **dict.fromkeys((3, 4, 5), "spindle"),
    **dict.fromkeys((7, 8), "coolant"),
    9: "coolant off",
    **dict.fromkeys((48, 49), "override"),
}
_REFUSED_G = {
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


def codes_of(words: Words) -> tuple[dict[str, int], dict[str, Word]]:
    """G codes of a line in tenths, and M words, each by the group whose codes exclude each other.

    Raises:
        ToolpathError: a code that is not supported, or two of one group.
    """
    g_codes: dict[str, int] = {}
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
            g_codes[group] = code
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
