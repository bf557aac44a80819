"""Fabrics are in SI units, with one number for both threads or a pair (warp, weft).

The columns of a grid are warp, and so is the second axis of a mesh's pattern. `cape.MEASUREMENTS` tells who
measured each, the source's own figures, and what was filled in. The default, `cape`, is no measured one: `worsted`,
a plain wool, has an eighth of its stiffness in shear. `cape.cloth.looks.maps.maps_of(look)` makes albedo, normals
and roughness of a weave.
"""

import cape

denim = cape.fabric("denim")
print(f"warp {denim.stretch_warp:.0f} N/m, weft {denim.stretch_weft:.0f} N/m;", cape.MEASUREMENTS["denim"].source)
own = cape.Fabric(density=0.15, stretch=(1500.0, 900.0), shear=25.0, bend=(8e-6, 5e-6))  # kg/m2, N/m, N/m, N m
print(cape.Cloth.cape(fabric=own).fabric)
