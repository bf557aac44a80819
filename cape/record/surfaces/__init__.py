"""How surfaces look: normals, textures, solids of revolution."""
