"""Fixtures of the tests of outfits."""

from tests.commands.conftest import forks

__all__ = ["forks"]
