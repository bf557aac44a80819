"""Fixtures of the scenes' tests."""

from tests.commands.conftest import forks

__all__ = ["forks"]
