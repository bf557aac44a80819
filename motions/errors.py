"""The errors that a user's input can cause; the command line prints each as one line and exits with status 2."""

from collections.abc import Iterable
from operator import index


class UserError(ValueError):
    """Base of every error caused by input: the text names what was wrong and what was available."""


class FileError(UserError):
    """A file that is missing, unreadable, malformed or can't be written."""


class ValueRangeError(UserError):
    """A number or an array that is outside of what makes sense."""


class UnknownNameError(UserError):
    """A name that is not among the ones that exist."""

    def __init__(self, kind: str, name: str, available: Iterable[str], hint: str = ""):
        """State that `name` is no `kind`, list the `available` ones and close with the `hint`."""
        listed = ", ".join(available) or "none"
        super().__init__(f"no {kind} named {name!r}; available: {listed}" + (f". {hint}" if hint else ""))


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
