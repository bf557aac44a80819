"""Tests of cloth, scenes and their arrays."""
