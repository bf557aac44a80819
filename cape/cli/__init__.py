"""The command `cape`."""

import errno
import gc
import os
import signal
import sys
from types import FrameType

from cape.streams import READER_GONE, ReaderGone, Stream, guard
from motions.errors import PACKAGES, UserError, missing_package
from motions.files import printable

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
NO_WAY = (errno.ENAMETOOLONG, errno.EACCES, errno.EPERM, errno.ELOOP)
INTERRUPTED = 130  # the shells' status for what Ctrl-C has ended; of other signals it is 128 and their number


def main() -> None:
    """Run the command; a user's mistake is one line on standard error and exit status 2, an interrupt is one line.

    So is a standard output that can't take all that is printed, which the command has gone on without.
    """
    gc.freeze()  # what was imported lives as long as the command, and need not be looked through again and again
    printed = guard()
    interrupted: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupted.append(number)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    for number in (signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        if signal.getsignal(number) == signal.SIG_DFL:  # nohup has it ignored
            signal.signal(number, interrupt)
    try:
        status = _run()
    except ReaderGone:
        status = READER_GONE
    except (Exception, KeyboardInterrupt) as error:
        # What an interrupt reaches, such as a viewer, may fail before this process takes notice, or take it for a
        # failure of its own.
        status = INTERRUPTED if interrupted else _status_of(error)
    if interrupted and status == INTERRUPTED:
        status = _tell("interrupted", 128 + interrupted[0])
    status = _status_with(printed, status)
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # nothing is left that would have to end in order
    if interrupted and _is_compiling():
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)  # a process does not end well while LLVM is at work in it
    sys.exit(status)


def _run() -> int:
    import typer

    from cape.cli.app import app
    from cape.cli.compiling_told import tell, telling

    tell()
    command = typer.main.get_command(app)
    try:
        status = command.main(prog_name="cape", standalone_mode=False)
    finally:
        telling.close()
    return status if isinstance(status, int) else 0


def _status_with(printed: Stream, status: int) -> int:
    """The status to exit with once all is printed, told where that is not possible."""
    try:
        sys.stdout.flush()
    except ReaderGone:
        return status or READER_GONE
    if printed.failure is None or isinstance(printed.failure, BrokenPipeError):
        return status
    told = _tell(f"can't write to standard output: {printed.failure.strerror}", 2)
    return told if status < INTERRUPTED else status


def _status_of(error: BaseException) -> int:
    """The status to exit with, told if need be; what is nobody's mistake but this program's is raised."""
    import typer
    from typer.exceptions import TyperException

    if isinstance(error, UserError):
        return _tell(error.at_command_line, 2)
    if isinstance(error, ImportError) and error.name == "numba":
        return _tell(str(error), 2)
    if isinstance(error, ModuleNotFoundError) and error.name in PACKAGES:
        return _tell(str(missing_package(error.name, "this")), 2)
    if isinstance(error, TyperException):
        context = getattr(error, "ctx", None)  # of most of them: the command whose use was wrong
        command = "cape" if context is None else context.command_path
        return _tell(f"{error.format_message()} ({command} --help tells what there is)", 2)
    if isinstance(error, BrokenPipeError):
        return 1
    if isinstance(error, OSError) and error.errno in FULL:
        return _tell(f"can't write {error.filename or 'a file'}: {error.strerror}", 2)
    if isinstance(error, OSError) and error.errno in NO_WAY and error.filename:
        return _tell(f"can't use {error.filename}: {error.strerror}", 2)
    if isinstance(error, typer.Abort):
        if (cut := _cut_short(error.__cause__)) is not None:
            return _tell(f"can't load {cut}: it is cut short, as by a full disk; remove it, it is made anew", 2)
        return INTERRUPTED
    raise error


def _cut_short(error: BaseException | None) -> str | None:
    """The file of Python's own compiled code that an import found not whole; None where that is not what happened."""
    frame = error.__traceback__ if isinstance(error, EOFError) else None
    while frame is not None:
        if "bytecode_path" in frame.tb_frame.f_locals:
            return str(frame.tb_frame.f_locals["bytecode_path"])
        frame = frame.tb_next
    return None


def _tell(text: str, status: int) -> int:
    from cape.cli.words import shortened

    print(shortened(printable("cape: " + " ".join(text.split()))), file=sys.stderr)
    return status


def _is_compiling() -> bool:
    """Tell whether code is still being compiled that nobody waits for any more."""
    compiling = sys.modules.get("cape.kernels.compiling")
    return compiling is not None and compiling.is_going_on()
