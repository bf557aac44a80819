"""Fabrics as their sources measured them, from silk's weight to leather's.

ARCSim's tables are those of Wang, O'Brien and Ramamoorthi, who ask that publications cite their paper; of each stand
here the rows and columns that a linear fabric needs. Woven fabrics are as stiff along their threads as at rest, knits
as at 5 % of strain: at rest their rows tell of negative coupling, which can't be, and the softest are softer along a
thread than in shear, which springs can't be. What is kept of their stretch is that of a cloth free to narrow, since
that is how it hangs: a `Fabric`, told that of one held as wide as it was, then pulls alike
(`conversions.held_stretch`). Fabrics of which only bending was measured have the stretch and shear of the worsted by
mass.
"""

from typing import Final

from cape.cloth.fabric import Fabric
from cape.cloth.measurement import Measurement, Source, by_arcsim, by_cantilever, by_fast, by_kes
from motions.border import checked
from motions.errors import UnknownNameError

KNIT = 0.05  # strain at which knits are as stiff as here

WANG: Final = Source(
    authors="Wang, O'Brien and Ramamoorthi",
    year=2011,
    title="Data-Driven Elastic Models for Cloth",
    published="ACM Transactions on Graphics 30(4), 71",
    via="as published with ARCSim 0.2",
)
MATSUDAIRA: Final = Source(
    authors="Matsudaira, Masuda, Wada and Yokura",
    year=2015,
    title="Shape Factor of Flared Skirts Compared with That of Circular Fabrics",
    published="Journal of Textile Engineering 61(6), 69-73",
    via="as transcribed in github.com/antonbj3/3fold-motion-engine",
)
FENG: Final = Source(
    authors="Feng, Huang, Xu and Wang",
    year=2022,
    title="Learning-Based Bending Stiffness Parameter Estimation by a Drape Tester",
    published="ACM Transactions on Graphics 41(6)",
    via="github.com/DrapeTester/ClothDrapeTester",
)
LABORATORY: Final = Source(
    authors="a student's report on FAST",
    year=None,
    title="Fabric Assurance by Simple Testing",
    published="bartleby.com/essay (P3YWEKCTJ) and majortests.com/essay (P3S9UTUQSS)",
)

WORSTED: Final = by_fast(
    material="wool, plain weave",
    source=LABORATORY,
    place="tables III to VII",
    weight=168.0,
    e5=(0.67, 0.40),
    e20=(1.87, 1.87),
    eb5=4.7,
    bending_length=(15.00, 14.50),
    remark="a weak source, whose figures agree with each other; the one whole row of a suiting",
)

MEASUREMENTS: Final[dict[str, Measurement]] = {
    "worsted": WORSTED,
    "denim": by_arcsim(
        material="denim of 11 oz",
        source=WANG,
        name="11oz-black-denim",
        density=0.324,
        at_rest=(205.352, 10.2341, 1013.89, 53.3872),
        along_weft=(232.028, 40.6463, 1052.84, 64.9805),
        along_warp=(225.767, 40.9179, 1051.56, 71.8106),
        bending=((64.1965, 60.2862, 60.9434), (73.3846, 59.672, 61.0808), (96.9516, 107.848, 113.061)),
    ),
    "jersey": by_arcsim(
        material="interlock, a knit",
        source=WANG,
        name="gray-interlock",
        density=0.187,
        at_rest=(16.5938, -14.696, 34.4771, 36.8603),
        along_weft=(46.3648, 53.6947, 261.014, -29.6913),
        along_warp=(127.444, 85.8486, 405.873, 32.2384),
        bending=((23.1917, 32.9322, 34.4065), (24.75, 18.6513, 16.3706), (14.2676, 7.05291, 14.5152)),
        strain=KNIT,
        remark="at rest 69 and 33 N/m along the threads, less than its shear: springs can't have that",
    ),
    "ponte": by_arcsim(
        material="ponte roma, a double knit",
        source=WANG,
        name="camel-ponte-roma",
        density=0.284,
        at_rest=(31.1462, -12.8027, 44.0287, 31.8964),
        along_weft=(78.7078, 26.7546, 268.681, 27.7434),
        along_warp=(143.933, 49.6548, 191.778, 39.4911),
        bending=((36.3484, 49.5855, 45.7441), (33.0133, 29.7444, 35.1036), (37.1576, 34.1075, 33.2294)),
        strain=KNIT,
        remark="at rest 88 and 62 N/m along the threads",
    ),
    "rib": by_arcsim(
        material="rib knit",
        source=WANG,
        name="ivory-rib-knit",
        density=0.276,
        at_rest=(42.871, -0.234556, 65.166, 83.1756),
        along_weft=(52.4225, 7.21909, 245.337, -31.1295),
        along_warp=(105.649, 0.416488, 254.593, 3.4725),
        bending=((46.2376, 63.0867, 83.1928), (30.0159, 30.0974, 30.1721), (32.2439, 37.3413, 38.8174)),
        strain=KNIT,
        remark="at rest 130 and 86 N/m along the threads",
    ),
    "sweater": by_arcsim(
        material="sweater knit",
        source=WANG,
        name="navy-sparkle-sweat",
        density=0.224,
        at_rest=(12.4863, -19.8753, 3.27243, 17.6163),
        along_weft=(32.1721, 56.0128, 283.466, -2.43844),
        along_warp=(92.3432, 117.527, 243.265, 47.3384),
        bending=((59.4697, 37.5, 35.7873), (40.0723, 37.4469, 35.2066), (45.625, 39.521, 30.7341)),
        strain=KNIT,
        remark="at rest 7 and 25 N/m along the threads, which springs of its shear can't have",
    ),
    "fleece": by_arcsim(
        material="blanket fleece",
        source=WANG,
        name="pink-ribbon-brown",
        density=0.228,
        at_rest=(151.504, 106.028, 244.831, 30.2502),
        along_weft=(164.124, 33.6897, 268.195, 30.0746),
        along_warp=(96.8058, 54.6269, 359.793, 30.3406),
        bending=((117.07, 202.683, 298.616), (87.5098, 36.3969, 103.628), (59.7743, 59.2606, 64.1997)),
        remark="narrows much as it is stretched, which springs don't",
    ),
    "jacket": by_arcsim(
        material="light jacket, polyester",
        source=WANG,
        name="tango-red-jet-set",
        density=0.113,
        at_rest=(43.0676, 54.3733, 171.425, 14.3147),
        along_weft=(75.1517, 82.1952, 236.164, -7.23038),
        along_warp=(227.029, -21.8654, 404.867, 62.636),
        bending=((14.2938, 8.94939, 30.0111), (21.9517, 22.4463, 18.4087), (20.3457, 22.6969, 15.6981)),
        remark="narrows much as it is stretched, which springs don't",
    ),
    "swim": by_arcsim(
        material="swimwear, nylon and elastane",
        source=WANG,
        name="white-swim-solid",
        density=0.204,
        at_rest=(47.9712, 6.83452, 104.615, 60.7737),
        along_weft=(40.369, 23.093, 169.666, -24.6819),
        along_warp=(68.6212, 40.132, 124.469, 36.1996),
        bending=((60.2379, 56.3572, 69.6986), (58.8032, 63.122, 61.3792), (51.0188, 50.7415, 50.5706)),
    ),
    "tablecloth": by_arcsim(
        material="tablecloth, polyester",
        source=WANG,
        name="white-dots-on-blk",
        density=0.128,
        at_rest=(2002.09, 0.345588, 2027.49, 19.189),
        along_weft=(2107.23, 36.3716, 2171.73, 16.9047),
        along_warp=(2107.31, 61.2163, 2150.48, 37.6688),
        bending=((51.7138, 36.507, 66.3607), (40.6595, 10.4017, 20.8478), (31.2828, 22.9103, 26.3504)),
        remark="stretch is the least that it may be: another fabric's rows are the same to 0.2 %",
    ),
    "twill": by_arcsim(
        material="trouser twill, cotton and polyester",
        source=WANG,
        name="royal-target",
        density=0.22,
        at_rest=(2016.55, 9.17051, 2034.98, 104.76),
        along_weft=(2109.52, 38.6046, 2173.94, 19.1292),
        along_warp=(2109.53, 63.424, 2152.74, 39.8857),
        bending=((125.41, 167.285, 215.413), (107.998, 120.583, 144.142), (125.41, 167.285, 215.413)),
        remark="stretch is the least that it may be; its bending along the weft is a copy of that along the warp",
    ),
    "broadcloth": by_kes(
        material="cotton broadcloth, plain weave",
        source=MATSUDAIRA,
        place="tables 1 and 2",
        b=0.118,
        hb2=0.124,
        w=12.38,
        thickness=0.497,
        drape=82.9,
        folds=2,
        like=WORSTED.fabric,
    ),
    "wool-tropical": by_kes(
        material="wool tropical, plain weave",
        source=MATSUDAIRA,
        place="tables 1 and 2",
        b=0.067,
        hb2=0.033,
        w=16.29,
        thickness=0.407,
        drape=49.8,
        folds=5,
        like=WORSTED.fabric,
    ),
    "polyester-tropical": by_kes(
        material="polyester tropical, plain weave",
        source=MATSUDAIRA,
        place="tables 1 and 2",
        b=0.077,
        hb2=0.029,
        w=11.65,
        thickness=0.34,
        drape=50.7,
        folds=5,
        like=WORSTED.fabric,
    ),
    "faille": by_kes(
        material="polyester faille, like silk",
        source=MATSUDAIRA,
        place="tables 1 and 2",
        b=0.019,
        hb2=0.007,
        w=10.43,
        thickness=0.226,
        drape=28.3,
        folds=7,
        like=WORSTED.fabric,
    ),
    "chiffon-weight": by_cantilever(
        material="as heavy as chiffon",
        source=FENG,
        place="dataset/dataset.csv, the row of 0.0235 kg/m2",
        density=0.0235,
        bend=(2.36, 0.77, 0.75),
        like=WORSTED.fabric,
    ),
    "lining-weight": by_cantilever(
        material="as heavy as a silk lining",
        source=FENG,
        place="dataset/dataset.csv, the row of 0.0673 kg/m2",
        density=0.0673,
        bend=(1.78, 3.08, 2.24),
        like=WORSTED.fabric,
    ),
    "leather-weight": by_cantilever(
        material="as heavy as thick leather",
        source=FENG,
        place="dataset/dataset.csv, the row of 0.8703 kg/m2",
        density=0.8703,
        bend=(199.0, 123.0, 63.0),
        like=WORSTED.fabric,
    ),
}

FABRICS: Final[dict[str, Fabric]] = {
    "cape": Fabric(),  # no measured one
    **{name: measurement.fabric for name, measurement in MEASUREMENTS.items()},
}


@checked
def fabric(name: str) -> Fabric:
    """Give the fabric of that name.

    Raises:
        UnknownNameError: there is no such fabric.
    """
    if name not in FABRICS:
        raise UnknownNameError("fabric", name, sorted(FABRICS))
    return FABRICS[name]
