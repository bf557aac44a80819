"""`cape doctor`: what this machine has of what the project uses, and how to get what it lacks."""

import importlib.metadata
import json as json_format
import os
import platform
import re
import sys
from pathlib import Path
from typing import Any

from cape.cli.figures.rows import print_rows
from cape.kernels import store
from cape.version import VERSION
from motions.errors import UserError

WITHOUT = {
    "pin": "robots",
    "example-robot-data": "robots known by name",
    "rerun-sdk": "recordings and pictures",
}
"""What there is not without a package of those that the rest does without."""
USES = {
    "plots": "diagrams of cape report and cape bench",
    "export": "exports of takes as USD and GLB",
    "film": "films of cape render as MP4",
    "retarget": "robots that follow a clip",
    "cluster": "cape batch on other machines",
    "live": "cape live --by-hand",
    "notebook": "take.show in Jupyter",
}


def run(*, json: bool) -> int:
    """Look at the machine and tell; gives the exit status, which is 1 where a package is missing."""
    found = look()
    if json:
        print(json_format.dumps(found))
    else:
        print_rows(_rows(found))
    return 0 if all(found["packages"].values()) else 1


def look() -> dict[str, Any]:
    """What there is: versions, None for what is missing, and whether pictures can be drawn."""
    needed, extras = _requirements()
    place = store.folder()
    try:
        from cape.pictures.viewer import require_viewer

        require_viewer()
        pictures = None
    except (UserError, ImportError) as error:
        pictures = str(error)
    return {
        "cape": VERSION,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cores": len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count(),
        "cache": None if place is None else str(place),
        "cache_mb": None if place is None else round(_size(place) / 1e6, 1),
        "packages": {name: _version(name) for name in needed},
        "extras": {extra: {name: _version(name) for name in names} for extra, names in extras.items()},
        "pictures": "drawn" if pictures is None else pictures,
    }


def _rows(found: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ("cape", f"{found['cape']}, Python {found['python']}, {found['platform']}"),
        ("cores", str(found["cores"])),
        ("compiled code", f"{found['cache']}, {found['cache_mb']} MB" if found["cache"] else "can't be kept"),
        ("packages", ", ".join(f"{name} {version or 'MISSING'}" for name, version in found["packages"].items())),
        ("pictures", found["pictures"]),
    ]
    lacking = [name for name, version in found["packages"].items() if version is None]
    rows += [(f"for {use}", f"lacks {name}: pip install {name}") for name, use in WITHOUT.items() if name in lacking]
    for extra, names in found["extras"].items():
        missing = [name for name, version in names.items() if version is None]
        # An extra of cape would also install what is left out on purpose.
        ask = " ".join(missing) if lacking else f"'cape[{extra}]'"
        told = f"lacks {', '.join(missing)}: pip install {ask}" if missing else "there"
        rows.append((f"for {USES[extra]}", told))
    return rows


def _requirements() -> tuple[list[str], dict[str, list[str]]]:
    """The packages that the project needs, and those of each extra that a user has a use for."""
    needed: list[str] = []
    extras: dict[str, list[str]] = {extra: [] for extra in USES}
    for line in importlib.metadata.requires("cape") or []:
        if 'platform_system != "Windows"' in line.replace("'", '"') and platform.system() == "Windows":
            continue
        name = re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0]
        extra = re.search(r"extra == ['\"]([\w-]+)['\"]", line)
        if extra is None:
            needed.append(name)
        elif extra[1] in extras:
            extras[extra[1]].append(name)
    return needed, extras


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _size(place: Path) -> int:
    return sum(entry.stat().st_size for entry in os.scandir(place) if entry.is_file())
