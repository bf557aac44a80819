"""Tests of the add-on for Blender."""
