"""Tables of printed cells as text."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self


class ResultTable(NamedTuple):
    """Names of columns, and rows of printed cells."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, str]]) -> Self:
        """Return the table of rows that hold their cells by the names of the columns."""
        return cls(list(rows[0]) if rows else [], [list(row.values()) for row in rows])


def text_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; all columns but the first two are right-aligned."""
    columns = list(zip(head, *rows, strict=True))
    widths = [max(3, *(len(cell) for cell in column)) for column in columns]
    rule = [("-" * width if index < 2 else "-" * (width - 1) + ":") for index, width in enumerate(widths)]
    lines = [_line(head, widths), "| " + " | ".join(rule) + " |"]
    lines += [_line(row, widths) for row in rows]
    return "\n".join(lines)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    aligned = [
        cell.ljust(width) if index < 2 else cell.rjust(width)
        for index, (cell, width) in enumerate(zip(cells, widths, strict=True))
    ]
    return "| " + " | ".join(aligned) + " |"


def number(value: float | None, digits: int) -> str:
    """Return a number with the given number of decimals, or a dash for None."""
    return "-" if value is None else f"{value:.{digits}f}"
