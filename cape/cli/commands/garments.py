"""`cape garments`: what a character may wear."""

import json as json_format

from cape.cli.figures.rows import print_rows
from cape.garments.registry import GARMENTS


def run(*, json: bool) -> int:
    """List the garments; gives the exit status."""
    titles = {garment.name: garment.title for garment in GARMENTS.values()}
    if json:
        print(json_format.dumps(titles))
    else:
        print_rows(list(titles.items()))
    return 0
