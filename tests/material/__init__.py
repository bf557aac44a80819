"""Tests of cloth as a material: how it bends, stretches, and where it stops stretching."""
