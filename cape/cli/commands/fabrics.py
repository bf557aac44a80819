"""`cape fabrics`: which fabrics there are, how each drapes, and where its figures are from."""

import json as json_format
from pathlib import Path
from typing import Any

from cape.cli.figures.rows import print_rows
from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import FABRICS, MEASUREMENTS
from cape.cloth.looks.maps import textures_of
from cape.cloth.looks.registry import LOOKS
from cape.cloth.measurement import Measurement, bending_lengths, drapes
from motions.errors import FileError

NOT_MEASURED = "no measured fabric: the default, which figures of cape are made with"


def run(*, json: bool, write: Path | None = None) -> int:
    """List the fabrics, the lightest first, or write their textures to a folder; gives the exit status."""
    if write is not None:
        return _write(write, json)
    names = sorted(FABRICS, key=lambda name: FABRICS[name].density)
    if json:
        print(json_format.dumps({name: _facts(FABRICS[name], MEASUREMENTS.get(name)) for name in names}))
    else:
        print_rows([(name, _text(FABRICS[name], MEASUREMENTS.get(name))) for name in names])
    return 0


def _write(folder: Path, json: bool) -> int:
    """Write the textures of each fabric as PNG.

    Raises:
        FileError: one can't be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"can't make the folder {folder}: {error.strerror}") from error
    files = {name: textures_of(LOOKS[name]).write(folder, name) for name in FABRICS}
    if json:
        print(json_format.dumps({name: [str(path) for path in paths] for name, paths in files.items()}))
    else:
        print_rows([(name, ", ".join(path.name for path in paths)) for name, paths in files.items()])
    return 0


def _text(fabric: Fabric, measured: Measurement | None) -> str:
    """What it is, how it drapes, what it weighs and how stiff it is, and the source."""
    stretch = _threads(fabric.stretch_warp, fabric.stretch_weft, ".0f")
    bend = _threads(1e6 * fabric.bend_warp, 1e6 * fabric.bend_weft, ".3g")
    warp, weft = bending_lengths(fabric)
    lengths = _threads(100.0 * warp, 100.0 * weft, ".1f")
    told = [
        f"{drapes(fabric)}, bending length {lengths} cm",
        f"{1000.0 * fabric.density:.3g} g/m2, stretch {stretch} N/m, shear {fabric.shear:.3g} N/m, bend {bend} µN m",
        NOT_MEASURED if measured is None else f"{measured.source.authors} {measured.source.year or ''}".rstrip(),
    ]
    if measured is not None:
        told[0] = f"{measured.material}: {told[0]}"
        filled = [name for name in measured.filled if name.startswith("stretch")]
        told += [f"{name} not measured" for name in filled]
    return "; ".join(told)


def _threads(warp: float, weft: float, form: str) -> str:
    """One figure, or those along warp and weft where they differ."""
    both = list(dict.fromkeys(format(value, form) for value in (warp, weft)))
    return " / ".join(both)


def _facts(fabric: Fabric, measured: Measurement | None) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "density_kg_m2": fabric.density,
        "stretch_N_m": [fabric.stretch_warp, fabric.stretch_weft],
        "shear_N_m": fabric.shear,
        "bend_N_m": [fabric.bend_warp, fabric.bend_weft],
        "bending_length_m": list(bending_lengths(fabric)),
        "drapes": drapes(fabric),
        "measured": None,
    }
    if measured is not None:
        facts["measured"] = {
            "material": measured.material,
            "source": str(measured.source),
            "place": measured.place,
            "figures": dict(measured.figures),
            "filled": dict(measured.filled),
            "remark": measured.remark,
            "poisson": None if measured.plane is None else list(measured.plane.poisson),
            "bend_bias_N_m": measured.bend_bias,
            "bend_friction_N": measured.bend_friction,
            "thickness_m": measured.thickness,
            "drape": measured.drape,
        }
    return facts
