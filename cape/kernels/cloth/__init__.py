"""Forces within a cloth and of the air, on grids and on meshes, and measures of it."""
