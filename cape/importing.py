"""Ctrl-C while the command's modules are imported, which takes half a second: the process ends at once, without a word.

It is imported before all others. Python's own way is to raise `KeyboardInterrupt` in the middle of one of them, and to
print where that was. Once it runs the command hears of interrupts itself (`cape.cli.main`); where the library is
imported by another program, that keeps the way it has.
"""

import os
import signal
import sys
from collections.abc import Sequence

_MODULES = ("cape", "cape.cli", "cape.__main__", "cape.cli.__main__")


def is_command(started: str, words: Sequence[str]) -> bool:
    """Tell whether this process is the command `cape`, as a script or as `python -m cape`.

    Args:
        started: `sys.argv[0]`, which is "-m" as long as Python looks for the module.
        words: `sys.orig_argv`. Processes that a command starts to share its work may be given its `sys.argv`.
    """
    if started != "-m":
        return started in words and os.path.splitext(os.path.basename(started))[0] == "cape"
    for word, following in zip(words, [*words[1:], ""], strict=True):
        if word.startswith("-m"):
            return (word.removeprefix("-m") or following) in _MODULES
    return False


_is_default = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # a shell may have it ignored
if _is_default and is_command(sys.argv[0] if hasattr(sys, "argv") else "", sys.orig_argv):
    signal.signal(signal.SIGINT, signal.SIG_DFL)
