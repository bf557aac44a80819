"""Motions of parametric bodies, as AMASS distributes them: rotations for joints whose places the files do not hold."""
