"""Fixtures of the tests of characters."""

from tests.commands.conftest import forks

__all__ = ["forks"]
