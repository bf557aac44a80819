"""Tests of the command line, the benchmark and the report."""
