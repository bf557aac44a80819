"""Labelled rows on the terminal."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from motions.files import printable


def print_rows(rows: Sequence[tuple[str, str]]) -> None:
    """Print a label and a text a row, the texts aligned and folded to the terminal's width."""
    table = Table(show_header=False, box=None)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for label, text in rows:
        table.add_row(printable(label), "\n".join(map(printable, text.split("\n"))))
    Console(highlight=False, markup=False).print(table)
