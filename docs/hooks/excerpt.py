"""Excerpts of functions: some statements, the `if` and `for` around them, and a mark wherever others are left out."""

import ast
from collections.abc import Sequence
from textwrap import dedent

MARK = "..."


def excerpt(code: str, texts: Sequence[str]) -> str:
    """The statements of a function that contain one of some texts.

    Raises:
        ValueError: A text is in none of the statements.
    """
    code = dedent(code)
    (function,) = ast.parse(code).body
    assert isinstance(function, ast.FunctionDef)
    lines = _Excerpt(code.splitlines(), texts).block(function.body)
    missing = [text for text in texts if not any(text in line for line in lines)]
    if missing:
        raise ValueError(f"{function.name} has no line with {', '.join(missing)}.")
    return dedent("\n".join(lines))


class _Excerpt:
    def __init__(self, lines: list[str], texts: Sequence[str]) -> None:
        self.lines = lines
        self.texts = texts

    def block(self, statements: Sequence[ast.stmt]) -> list[str]:
        """The lines of a block; none if it has none of the texts."""
        chosen: list[str] = []
        cut = False
        mark = " " * statements[0].col_offset + MARK if statements else ""
        for statement in statements:
            lines = self.statement(statement)
            chosen += [mark, *lines] if lines and cut else lines
            cut = not lines and (cut or not _is_docstring(statement))
        return [*chosen, mark] if chosen and cut else chosen

    def statement(self, statement: ast.stmt) -> list[str]:
        """The lines of a statement, and of those in it; none if it has none of the texts."""
        body: list[ast.stmt] = getattr(statement, "body", [])
        if not body or body[0].lineno == statement.lineno:
            return self.having(statement.lineno, statement.end_lineno or statement.lineno)
        orelse: list[ast.stmt] = getattr(statement, "orelse", [])
        inside, otherwise = self.block(body), self.block(orelse)
        first, last = statement.lineno, body[0].lineno - 1
        while self.lines[last - 1].lstrip().startswith("#"):  # a comment on the first statement inside
            last -= 1
        if not (inside or otherwise or self.having(first, last)):
            return []
        lines = [*self.lines[first - 1 : last], *(inside or self.cut(body))]
        if orelse and not self.lines[orelse[0].lineno - 1].lstrip().startswith("elif"):
            lines.append(" " * statement.col_offset + "else:")
        return [*lines, *(otherwise or self.cut(orelse))]

    def cut(self, block: Sequence[ast.stmt]) -> list[str]:
        return [" " * block[0].col_offset + MARK] if block else []

    def having(self, first: int, last: int) -> list[str]:
        """Some lines, counted from 1, if they have one of the texts."""
        lines = self.lines[first - 1 : last]
        return lines if any(text in line for text in self.texts for line in lines) else []


def _is_docstring(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
