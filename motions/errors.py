"""The errors that a user's input can cause; the command line prints each as one line and exits with status 2."""

import difflib
import importlib.util
from collections.abc import Iterable, Sequence
from operator import index


class UserError(ValueError):
    """Base of every error caused by input: the text names what was wrong and what was available."""

    @property
    def at_command_line(self) -> str:
        """The text for those who use the command line, not Python."""
        return str(self)


class FileError(UserError):
    """A file that is missing, unreadable, malformed or can't be written."""


class ValueRangeError(UserError):
    """A number or an array that is outside of what makes sense."""


class MissingPackageError(UserError):
    """A package that something needs is not installed; the text says how to get it."""


PACKAGES = {
    "pinocchio": ("Pinocchio", "pin"),
    "coal": ("coal", "pin"),
    "rerun": ("Rerun", "'rerun-sdk>=0.41,<0.42'"),
    "rerun_cli": ("Rerun", "'rerun-sdk>=0.41,<0.42'"),
}
"""Modules that only some tasks need: what they are called, and what to install. They come along where a platform has
them."""


def require_package(module: str, what: str, *, instead: str = "") -> None:
    """Check that a module can be imported, without importing it.

    Args:
        module: one of `PACKAGES`.
        what: what needs it, in a few words.
        instead: what there is without it, in a few words.

    Raises:
        MissingPackageError: it can't.
    """
    if importlib.util.find_spec(module) is None:
        raise missing_package(module, what, instead=instead)


def missing_package(module: str, what: str, *, instead: str = "") -> MissingPackageError:
    """The error of a module of `PACKAGES` that is not there."""
    name, package = PACKAGES[module]
    return MissingPackageError(f"{what} needs {name}: pip install {package}" + (f" ({instead})" if instead else ""))


class UnknownNameError(UserError):
    """A name that is not among the ones that exist."""

    def __init__(self, kind: str, name: str, available: Iterable[str], hint: str = ""):
        """State that `name` is no `kind`, list the `available` ones, tell which is meant, close with the `hint`."""
        known = list(available)
        like = likeliest(name, known)
        meant = f"; did you mean {like!r}?" if like else "." if hint else ""
        listed = ", ".join(known) or "none"
        super().__init__(f"no {kind} named {name!r}; available: {listed}{meant}" + (f" {hint}" if hint else ""))


def likeliest(name: str, available: Iterable[str]) -> str | None:
    """The one of the available names that was meant, by how alike they are; None where none is."""
    by_letters = {each.casefold(): each for each in available}
    found = difflib.get_close_matches(name.casefold(), by_letters, n=1, cutoff=0.7)
    return by_letters[found[0]] if found else None


class MissingRolesError(UnknownNameError):
    """Roles that no bone plays."""

    def __init__(self, roles: Sequence[str], bones: Sequence[str]):
        """State that none of the `bones` plays any of the `roles`, and how to name some by hand."""
        kind = "bone for the role" if len(roles) == 1 else "bones for the roles"
        self._text = f"no {kind} {', '.join(map(repr, roles))}; name {'it' if len(roles) == 1 else 'them'} by hand: "
        self._roles, self._bones = tuple(roles), f". Bones: {', '.join(bones) or 'none'}"
        ValueError.__init__(self, self._text + f'roles={{"{roles[0]}": "NAME"}}' + self._bones)

    @property
    def at_command_line(self) -> str:
        """The same with options in place of arguments."""
        return self._text + f"--attach {self._roles[0]}=BONE" + self._bones


def require_whole(name: str, value: object, least: int, most: int) -> None:
    """Check that a value is a whole number within bounds.

    Raises:
        ValueRangeError: it is none, or outside of them.
    """
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise ValueRangeError(f"{name} must be a whole number, not {value!r}")
    number = index(value)  # pyright: ignore[reportArgumentType]
    if not least <= number <= most:
        bound = f"{least} or more" if number < least else f"{most} at most"
        raise ValueRangeError(f"{name} must be {bound}, not {value}")
