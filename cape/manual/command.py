"""`cape manual`: the chapters, or one of them, for a terminal or as it is written."""

import sys

from cape.cli.figures.rows import print_rows
from cape.manual import NAMES, chapter, title


def run(name: str | None) -> int:
    """Print a chapter, or which there are.

    Raises:
        UnknownNameError: there is no such chapter.
    """
    if name is None:
        print_rows([(each, title(each)) for each in NAMES])
        return 0
    text = chapter(name)
    if sys.stdout.isatty():
        from rich.console import Console
        from rich.markdown import Markdown

        Console().print(Markdown(text))
    else:
        print(text, end="")
    return 0
