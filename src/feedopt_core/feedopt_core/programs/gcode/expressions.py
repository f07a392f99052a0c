"""Numbers, parameters and expressions of a line, evaluated while they are read.

Operators and functions are those of the LinuxCNC manual, "Expressions" and "Functions": five levels of precedence, all
of them from left to right, angles in degrees.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable

from feedopt_core.programs.gcode.source_line import SourceLine

MAX_DEPTH = 50
"""Brackets, signs and # inside one another; deeper is a broken program, and would end in the recursion limit."""
MAX_PARAMETER = 5000
"""From 5001 on parameters belong to the control (positions, offsets, probe results)."""
_EQUAL = 1e-6
"""LinuxCNC: numbers that differ by less are EQ."""
_NUMBER = re.compile(r"\d+\.?\d*|\.\d+")
_NAME = re.compile(r"<([^<>\[\]]+)>")
_EXISTS = re.compile(r"\[#<([^<>\[\]]+)>\]")
_FUNCTIONS = re.compile(r"asin|acos|atan|sin|cos|tan|abs|round|fix|fup|exp|ln|sqrt|exists")
_OPERATORS = re.compile(r"\*\*|[-+*/]|mod|and|xor|or|eq|ne|gt|ge|lt|le")
_LEVEL = {"**": 5, "*": 4, "/": 4, "mod": 4, "+": 3, "-": 3, "and": 1, "or": 1, "xor": 1}
_COMPARISON_LEVEL = 2


class Parameters:
    """Numbered and named parameters of a running program."""

    def __init__(self) -> None:
        self.numbered: dict[int, float] = {}
        self.named: dict[str, float] = {}


class ValueReader:
    """Reads values from a line, from left to right.

    Attributes:
        at: index in the compact text of the next character.
    """

    def __init__(self, line: SourceLine, parameters: Parameters) -> None:
        self.at = 0
        self._line = line
        self._text = line.compact
        self._parameters = parameters
        self._depth = 0

    def value(self) -> float:
        """A number, parameter, expression in brackets or function, with or without a sign; finite.

        Raises:
            ToolpathError: there is none, or it has no finite value.
        """
        number = _NUMBER.match(self._text, self.at)
        if number:
            start, self.at = self.at, number.end()
            return self._finite(float(number[0]), start)
        start = self.at
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self._line.error(f"more than {MAX_DEPTH} brackets, signs and # inside one another", start)
        first = self._text[start : start + 1]
        if first in ("+", "-"):
            self.at += 1
            value = -self.value() if first == "-" else self.value()
        elif first == "[":
            value = self._bracketed()
        elif first == "#":
            value = self._parameter()
        else:
            value = self._function()
        self._depth -= 1
        return value

    def parameter_key(self) -> int | str:
        """Number or name of the parameter after a #."""
        name = _NAME.match(self._text, self.at)
        if name:
            self.at = name.end()
            return name[1]
        start = self.at
        number = self.value()
        if not 1 <= number <= MAX_PARAMETER or abs(number - round(number)) > 1e-4:
            raise self._line.error(
                f"parameter #{number:.12g} is not supported; there are #1 to #{MAX_PARAMETER} and #<name>", start
            )
        return round(number)

    def _parameter(self) -> float:
        start = self.at
        self.at += 1
        key = self.parameter_key()
        if isinstance(key, int):
            return self._parameters.numbered.get(key, 0.0)
        if key not in self._parameters.named:
            raise self._line.error(f"parameter #<{key}> is read before it is set", start)
        return self._parameters.named[key]

    def _bracketed(self) -> float:
        if self._text[self.at : self.at + 1] != "[":
            raise self._line.error("a '[' must stand here", self.at)
        self.at += 1
        value = self._binary(0)
        if self._text[self.at : self.at + 1] != "]":
            raise self._line.error("an operator or ']' must stand here", self.at)
        self.at += 1
        return value

    def _binary(self, level: int) -> float:
        """Operators of a higher level than this one, with their operands."""
        left = self.value()
        while sign := _OPERATORS.match(self._text, self.at):
            own = _LEVEL.get(sign[0], _COMPARISON_LEVEL)
            if own <= level:
                break
            start, self.at = self.at, sign.end()
            left = self._result(_OPERATIONS[sign[0]], start, left, self._binary(own))
        return left

    def _function(self) -> float:
        start = self.at
        name = _FUNCTIONS.match(self._text, start)
        if not name:
            found = self._text[start : start + 1]
            raise self._line.error(
                f"a number must stand here, not {found!r}" if found else "a number is missing", start
            )
        self.at = name.end()
        if name[0] == "exists":
            return self._exists()
        argument = self._bracketed()
        if name[0] != "atan":
            return self._result(_CALLS[name[0]], start, argument)
        if self._text[self.at : self.at + 1] != "/":
            raise self._line.error("ATAN takes two values: ATAN[y]/[x]", self.at)
        self.at += 1
        return math.degrees(math.atan2(argument, self._bracketed()))

    def _exists(self) -> float:
        found = _EXISTS.match(self._text, self.at)
        if not found:
            raise self._line.error("EXISTS takes a named parameter: EXISTS[#<name>]", self.at)
        self.at = found.end()
        return float(found[1] in self._parameters.named)

    def _result(self, function: Callable[..., float], start: int, *operands: float) -> float:
        try:
            return self._finite(float(function(*operands)), start)
        except ZeroDivisionError as error:
            raise self._line.error("division by zero", start) from error
        except (ValueError, OverflowError) as error:
            given = " and ".join(f"{operand:.12g}" for operand in operands)
            raise self._line.error(f"has no value for {given}", start) from error

    def _finite(self, value: float, start: int) -> float:
        if not math.isfinite(value):
            raise self._line.error("is too large for a number", start)
        return value


def _modulo(a: float, b: float) -> float:
    """LinuxCNC: never negative."""
    if b == 0.0:
        raise ZeroDivisionError
    rest = math.fmod(a, b)
    return rest + abs(b) if rest < 0.0 else rest


def _round(value: float) -> float:
    """Halves go away from zero."""
    return math.copysign(math.floor(abs(value) + 0.5), value)


_OPERATIONS: dict[str, Callable[[float, float], float]] = {
    # math.pow refuses what has no real value; the operator ** would turn complex.
    "**": math.pow,
    "*": operator.mul,
    "/": operator.truediv,
    "mod": _modulo,
    "+": operator.add,
    "-": operator.sub,
    "eq": lambda a, b: abs(a - b) < _EQUAL,
    "ne": lambda a, b: abs(a - b) >= _EQUAL,
    "gt": operator.gt,
    "ge": operator.ge,
    "lt": operator.lt,
    "le": operator.le,
    "and": lambda a, b: a != 0.0 and b != 0.0,
    "or": lambda a, b: a != 0.0 or b != 0.0,
    "xor": lambda a, b: (a != 0.0) != (b != 0.0),
}

_CALLS: dict[str, Callable[[float], float]] = {
    "sin": lambda a: math.sin(math.radians(a)),
    "cos": lambda a: math.cos(math.radians(a)),
    "tan": lambda a: math.tan(math.radians(a)),
    "asin": lambda a: math.degrees(math.asin(a)),
    "acos": lambda a: math.degrees(math.acos(a)),
    "abs": abs,
    "round": _round,
    "fix": math.floor,
    "fup": math.ceil,
    "exp": math.exp,
    "ln": math.log,
    "sqrt": math.sqrt,
}
