"""`cape addon`: a copy of the add-on for Blender that knows where this cape is."""

import shutil
import sys
from pathlib import Path

from cape.cli.figures.rows import print_rows
from cape.cli.output import output_path
from motions.errors import FileError
from motions.files import write_text

ADDON = Path(__file__).with_name("cape_blender.py")
SUFFIX = ".py"
_COMMAND = 'COMMAND = "cape"'  # the add-on's line that a copy has otherwise


def run(output: Path) -> int:
    """Write the copy and tell what to do with it; gives the exit status.

    Raises:
        FileError: it can't be written, or its name does not end in .py, which Blender needs.
    """
    path = output_path(output, "")
    if path.suffix != SUFFIX:
        raise FileError(f"can't write {path}: Blender takes add-ons named *{SUFFIX}")
    beside = Path(sys.executable).with_name("cape")
    command = str(beside) if beside.is_file() else shutil.which("cape") or "cape"
    text = ADDON.read_text(encoding="utf-8")
    write_text(path, text.replace(_COMMAND, f"COMMAND = {command!r}"))
    print_rows([
        ("add-on", str(path)),
        ("command", command),
        ("in Blender", "Edit > Preferences > Add-ons > Install from Disk, then N in the viewport, tab Cape"),
    ])  # fmt: skip
    return 0
