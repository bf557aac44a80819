"""What options tell of their values beyond their types, for who reads them elsewhere than on the command line."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class OneOf:
    """The value is one of some names, or several of them.

    Attributes:
        names: gives them.
        separator: between several; None for one alone.
        of: gives names of what it may be for, which then stand before it, as NAME=VALUE; None where it is for all.
    """

    names: Callable[[], Iterable[str]]
    separator: str | None = None
    of: Callable[[], Iterable[str]] | None = None


@dataclass(frozen=True)
class MayBeFile:
    """The value is a name, or a file's path, which has a suffix or a folder.

    Attributes:
        script: whether it is a script of several.
    """

    script: bool = False


def garments() -> Iterable[str]:
    """Names of the garments."""
    from cape.garments.registry import GARMENTS

    return GARMENTS


def fabrics() -> Iterable[str]:
    """Names of the fabrics."""
    from cape.cloth.fabrics import FABRICS

    return FABRICS


def solvers() -> Iterable[str]:
    """Names of the solvers, and of who chooses one."""
    from cape.run.auto import Auto
    from cape.solvers import SOLVERS

    return (*SOLVERS, Auto.name)


def cuts() -> Iterable[str]:
    """Names of what may become of the cape at a cut."""
    from cape.cli.commands.replay import CUTS

    return CUTS


def layers() -> Iterable[str]:
    """Names of a recording's layers."""
    from cape.record import LAYERS

    return LAYERS
