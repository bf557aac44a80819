"""Tests of garments: how they are cut to a body, and worn."""
