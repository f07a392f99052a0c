"""Compiled code addresses the columns of its arrays by names: a bare number would say nothing of its meaning."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import feedopt_core

CORE = Path(feedopt_core.__file__).parent


def compiled_functions() -> Iterator[tuple[str, ast.FunctionDef]]:
    for path in sorted(CORE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef) and any(ast.unparse(d) == "compiled" for d in node.decorator_list):
                yield path.relative_to(CORE).as_posix(), node


def bare_columns(function: ast.FunctionDef) -> list[str]:
    """Subscripts of several dimensions whose last one is a whole number."""
    found = []
    for node in ast.walk(function):
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Tuple):
            column = node.slice.elts[-1]
            if isinstance(column, ast.Constant) and isinstance(column.value, int):
                found.append(ast.unparse(node))
    return found


def test_no_kernel_addresses_a_column_by_a_bare_number() -> None:
    functions = list(compiled_functions())
    assert len(functions) > 50
    found = [f"{path}: {function.name}: {text}" for path, function in functions for text in bare_columns(function)]
    assert found == []


@pytest.mark.parametrize(
    ("line", "bare"), [("x = sides[r, 3]", True), ("x = sides[r, DUAL]", False), ("x = c[2]", False)]
)
def test_the_check_sees_a_bare_number(line: str, bare: bool) -> None:
    (function,) = ast.parse(f"def f(sides, c, r):\n    {line}\n").body
    assert isinstance(function, ast.FunctionDef)
    assert bool(bare_columns(function)) == bare
