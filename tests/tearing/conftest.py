"""Fixtures of the tests of tears."""

from tests.commands.conftest import forks

__all__ = ["forks"]
