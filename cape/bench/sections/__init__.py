"""Sections of the benchmark."""
