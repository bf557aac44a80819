"""Fixtures of the commands' tests."""

from collections.abc import Iterator

import pytest

from tests.support.command import Forks


@pytest.fixture(scope="session")
def forks(tmp_path_factory) -> Iterator[Forks]:
    """Runs commands of which there are many: each would spend most of its time importing, or much of it."""
    with Forks(tmp_path_factory.mktemp("forks")) as forks:
        yield forks
