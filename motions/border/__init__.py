"""The library's border: an argument of another kind than was asked for is the caller's mistake, and told as one."""

from motions.border.checking import checked, checked_first
from motions.border.kinds import fits

__all__ = ["checked", "checked_first", "fits"]
