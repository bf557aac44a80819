"""What a measurement was made on."""

import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

SYSTEM = Path("/sys/devices/system/cpu/cpu0/cache")
PACKAGES = ("cape", "numpy", "numba", "llvmlite")


def machine() -> dict[str, Any]:
    """Name of the processor, its cores, caches that one core sees [bytes], and the system; None for what is unknown."""
    return {
        "processor": _processor(),
        "architecture": platform.machine(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "caches": caches(),
        "system": f"{platform.system()} {platform.release()}",
    }


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide about speed."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


def caches(folder: Path = SYSTEM) -> dict[str, int]:
    """Sizes of the data caches that a core sees [bytes], by name (L1d, L2, L3); empty where the system does not say."""
    found = {}
    for index in sorted(folder.glob("index*")):
        try:
            level, kind, size = ((index / name).read_text().strip() for name in ("level", "type", "size"))
        except OSError:
            continue
        if kind != "Instruction":
            found[f"L{level}" + ("d" if kind == "Data" else "")] = _bytes(size)
    return found


def _bytes(size: str) -> int:
    """Bytes of what the kernel writes as 48K or 32M."""
    scale = {"K": 1024, "M": 1024**2, "G": 1024**3}.get(size[-1], 1)
    return int(size.rstrip("KMG")) * scale


def _processor() -> str | None:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or None
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or None
