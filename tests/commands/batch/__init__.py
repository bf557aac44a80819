"""Tests of many clips at once."""
