"""The errors that a user's input can cause; the command line prints each as one line and exits with status 2."""

from collections.abc import Iterable


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
