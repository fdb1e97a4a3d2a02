"""Plain-text tables, and bars: what has to hold, and whether it does."""

from __future__ import annotations

from collections.abc import Sequence

MARK = "|"


def table(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as text: the first column to the left, the others to the right.

    A column of "|" separates; rows may end early.
    """
    columns = max(len(row) for row in rows)
    full = [[*row, *[""] * (columns - len(row))] for row in rows]
    widths = [max(len(row[column]) for row in full) for column in range(columns)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in full
    )


def bar(holds: bool, text: str) -> str:
    """One line that says whether a relation holds, with its figures."""
    return f"  {'PASS' if holds else 'short of bar'}: {text}"
