"""`cape export`: a kept take for other programs, or as the recording that it would have been."""

import json as json_format
import os
import warnings
from pathlib import Path

from cape.cli.exports.writing import RECORDED
from cape.cli.figures.rows import print_rows
from cape.cli.output import output_path
from cape.exports import format_of, require_format
from cape.record import require_recorder
from cape.results.take import Take
from motions import clip_names
from motions.errors import FileError, UserError

MOST_TOLD = 5  # files of an export, each on a line; of more, the first and the last


def run(path: Path, output: Path, *, joints: int | None, json: bool) -> int:
    """Read, write and tell; gives the exit status."""
    recorded = output.suffix.lower() == RECORDED
    if recorded and joints is not None:
        raise UserError("joints are for binary glTF (.glb), not for recordings")
    if recorded:
        require_recorder()
    else:
        require_format(output, joints=joints)
    output_path(output, "", inputs=(path,))
    if not os.path.exists(path) and str(path) in clip_names():
        raise FileError(f"{path} is a motion, not a kept take: cape replay {path} -o {output} simulates and writes it")
    take = Take.load(path)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if recorded:
            take.save(output)
            files = (output,)
        else:
            files = take.export(output, joints=joints)
    fps = round(take.bones.fps, 3) if take.bones.frames > 1 else 0.0
    facts = {
        "take": take.name,
        "frames": len(take.positions),
        "fps": fps,
        "vertices": take.positions.shape[1],
        "format": "recording" if recorded else format_of(output).name,
        "warnings": [str(each.message) for each in caught if each.category is UserWarning],
        "output": str(files[0]),
        "files": [str(file) for file in files],
    }
    if json:
        print(json_format.dumps(facts))
        return 0
    first, *others = files
    beside = others if len(files) <= MOST_TOLD else others[-1:]
    rows = [
        ("take", f"{take.name}, {facts['frames']} frames at {fps:g} fps, {facts['vertices']} vertices"),
        *(("", note) for note in facts["warnings"]),
        (facts["format"], str(first)),
        *(("" if len(files) <= MOST_TOLD else f"to, {len(files)} in all", str(file)) for file in beside),
    ]
    print_rows(rows)
    return 0
