"""What was measured of a fabric, by whom, in which units, and the `Fabric` that comes of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cape.cloth import conversions
from cape.cloth.conversions import PlaneStiffness
from cape.cloth.fabric import Fabric, PerThread
from motions.border import checked

# Bending lengths [m] between which cloths fell in seven folds, in five, and in two, over a round plate: 1.22 cm, 1.60
# and 1.88 cm, 2.12 cm (Matsudaira and others 2015, tables 1 and 2).
MANY_FOLDS, FEW_FOLDS = 0.014, 0.020

DAMPING = {"damping times": "not measured: those of Fabric()"}


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where figures stand.

    Attributes:
        authors: who measured or published them.
        year: of the publication; None where it is not known.
        title: of the publication.
        published: journal, volume, page, or address.
        via: whose transcription was read, where it was not the source itself; "" for the source.
    """

    authors: str
    year: int | None
    title: str
    published: str
    via: str = ""

    def __str__(self) -> str:
        """One line."""
        when = "" if self.year is None else f" {self.year}"
        return f'{self.authors}{when}, "{self.title}", {self.published}' + (f", {self.via}" if self.via else "")


@checked
@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A fabric as its source measured it.

    Attributes:
        fabric: the same for a simulation, in SI units.
        material: what it is.
        source: where the figures stand.
        place: table and row, or file.
        figures: original figures with their units, by the source's own names.
        filled: what of the fabric was not measured, and by which rule it was filled in.
        remark: what to know of the figures; "" for nothing.
        plane: stiffness in the plane with the coupling of both threads, which springs can't have; None: not measured.
        bend_bias: bending moment per width and curvature at 45 degrees to the threads [N m]; None: not measured.
        bend_friction: moment per width that friction holds against bending [N], which is not simulated; None likewise.
        thickness: under little pressure [m]; None: not measured.
        drape: measured drape coefficient, as a share; None: not measured.
        folds: in which it was seen to fall then; None: not told.
    """

    fabric: Fabric
    material: str
    source: Source
    place: str
    figures: Mapping[str, str]
    filled: Mapping[str, str]
    remark: str = ""
    plane: PlaneStiffness | None = None
    bend_bias: float | None = None
    bend_friction: float | None = None
    thickness: float | None = None
    drape: float | None = None
    folds: int | None = None


def bending_lengths(fabric: Fabric) -> tuple[float, float]:
    """Lengths at which a fabric bends under its own weight, along warp and weft [m]: (B / (W g))^(1/3)."""
    warp, weft = (conversions.bending_length(fabric.density, bend) for bend in (fabric.bend_warp, fabric.bend_weft))
    return warp, weft


def drapes(fabric: Fabric) -> str:
    """How a fabric falls, by the geometric mean of its bending lengths."""
    warp, weft = bending_lengths(fabric)
    mean = (warp * weft) ** 0.5
    if mean < MANY_FOLDS:
        return "falls in many narrow folds"
    return "falls in some five folds" if mean < FEW_FOLDS else "falls in two or three wide folds"


def by_arcsim(
    *,
    material: str,
    source: Source,
    name: str,
    density: float,
    at_rest: Sequence[float],
    along_weft: Sequence[float],
    along_warp: Sequence[float],
    bending: Sequence[Sequence[float]],
    strain: float = 0.0,
    remark: str = "",
) -> Measurement:
    """A fabric of ARCSim's tables, whose first axis is taken as weft, the second as warp.

    Args:
        material: what it is.
        source: where the tables stand.
        name: of its file.
        density: mass per area [kg/m2].
        at_rest: C11, C12, C22, C33 of the first row of "stretching".
        along_weft: the second row, stretched by 1/6 along the first axis.
        along_warp: the last row, stretched along the second.
        bending: columns of 0, 10 and 20 per m of the three rows of "bending" [1e-6 N m].
        strain: at which the fabric is as stiff along its threads as its figures say.
        remark: what to know of the figures.
    """
    weft = conversions.arcsim_stretching(at_rest, along_weft, strain=strain)
    warp = conversions.arcsim_stretching(at_rest, along_warp, strain=strain)
    # Edges along the first axis are what the second bends around.
    bend_warp, bend_bias, bend_weft = (1e-6 * conversions.arcsim_bending(row) for row in bending)
    return Measurement(
        fabric=Fabric(
            density=density,
            stretch=conversions.held_stretch(warp.stretch_warp, weft.stretch_weft, weft.shear),
            shear=weft.shear,
            bend=(bend_warp, bend_weft),
            # What is as stiff as here only when strained is a knit: it gives as far as it was measured.
            strain_limit=conversions.ROWS_STRAINED_BY if strain > 0.0 else None,
        ),
        material=material,
        source=source,
        place=f"materials/{name}.json",
        figures={
            "density": f"{density:g} kg/m2",
            "stretching, unstrained": _listed(at_rest, "N/m"),
            "stretching, along u": _listed(along_weft, "N/m"),
            "stretching, along v": _listed(along_warp, "N/m"),
            **{
                f"bending, edge {edge}": _listed(row, "1e-6 N m")
                for edge, row in zip(("along u", "at 45 degrees", "along v"), bending, strict=True)
            },
        },
        filled={"warp and weft": "the axes v and u, which the file does not name; v is the stiffer", **DAMPING},
        remark=remark,
        plane=conversions.arcsim_stretching(at_rest),
        bend_bias=bend_bias,
    )


def by_fast(
    *,
    material: str,
    source: Source,
    place: str,
    weight: float,
    e5: tuple[float, float],
    e20: tuple[float, float],
    eb5: float,
    bending_length: tuple[float, float],
    remark: str = "",
) -> Measurement:
    """A fabric by FAST: weight [g/m2], E5, E20, EB5 [%] and bending length [mm], pairs along warp and weft."""
    density = 1e-3 * weight
    along_warp, along_weft = (conversions.fast_stretch(*loads) for loads in zip(e5, e20, strict=True))
    shear = conversions.fast_shear(eb5)
    stretch = conversions.held_stretch(along_warp, along_weft, shear)
    warp, weft = (conversions.cantilever_bending(density, 1e-3 * length) for length in bending_length)
    return Measurement(
        fabric=Fabric(density=density, stretch=stretch, shear=shear, bend=(warp, weft)),
        material=material,
        source=source,
        place=place,
        figures={
            "W": f"{weight:g} g/m2",
            "E5": _listed(e5, "%"),
            "E20": _listed(e20, "%"),
            "EB5": f"{eb5:g} %",
            "C": _listed(bending_length, "mm"),
        },
        filled=DAMPING,
        remark=remark,
    )


def by_kes(
    *,
    material: str,
    source: Source,
    place: str,
    b: float,
    hb2: float,
    w: float,
    thickness: float,
    drape: float,
    folds: int,
    like: Fabric,
) -> Measurement:
    """A fabric by KES: B [gf cm2/cm], 2HB [gf cm/cm], W [mg/cm2], thickness [mm], its drape [%] and folds.

    The source gives means of both threads. What it does not give is that of the fabric `like`, by mass.
    """
    density = conversions.kes_weight(w)
    return Measurement(
        fabric=_filled(density, conversions.kes_bending(b), like),
        material=material,
        source=source,
        place=place,
        figures={
            "B": f"{b:g} gf cm2/cm",
            "2HB": f"{hb2:g} gf cm/cm",
            "W": f"{w:g} mg/cm2",
            "T": f"{thickness:g} mm",
            "drape": f"{drape:g} %",
            "folds": f"{folds}",
        },
        filled=BY_MASS | DAMPING,
        remark="mean of both threads; friction holds folds that an elastic cloth lets go, so that it drapes less",
        bend_friction=conversions.kes_bending_friction(hb2),
        thickness=1e-3 * thickness,
        drape=1e-2 * drape,
        folds=folds,
    )


def by_cantilever(
    *, material: str, source: Source, place: str, density: float, bend: tuple[float, float, float], like: Fabric
) -> Measurement:
    """A fabric of which bending alone is known, along warp, weft and at 45 degrees [1e-6 N m], and mass [kg/m2].

    The rest is that of the fabric `like`, by mass.
    """
    warp, weft, bias = (1e-6 * value for value in bend)
    return Measurement(
        fabric=_filled(density, (warp, weft), like),
        material=material,
        source=source,
        place=place,
        figures={"density": f"{density:g} kg/m2", "bending, warp, weft, diagonal": _listed(bend, "1e-6 N m")},
        filled=BY_MASS | DAMPING,
        remark="a fabric without a name; its bending softens as it curves, here it is that of no curvature",
        bend_bias=bias,
    )


BY_MASS = {"stretch, shear": "those of worsted in proportion to mass per area: as much thread, as much stiffness"}


def _filled(density: float, bend: PerThread, like: Fabric) -> Fabric:
    """A fabric with the stretch and shear that another would have if it weighed as much."""
    ratio = density / like.density
    return Fabric(
        density=density,
        stretch=(ratio * like.stretch_warp, ratio * like.stretch_weft),
        shear=ratio * like.shear,
        bend=bend,
    )


def _listed(values: Sequence[float], unit: str) -> str:
    return ", ".join(f"{value:g}" for value in values) + f" {unit}"
