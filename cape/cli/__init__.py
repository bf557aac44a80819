"""The command `cape`."""

import signal
import sys
from types import FrameType

from motions.errors import UserError
from motions.files import printable


def main() -> None:
    """Run the command; a user's mistake is one line on standard error and exit status 2."""
    import typer
    from typer.exceptions import TyperException

    from cape.cli.app import app
    from cape.cli.compiling_told import tell, telling

    tell()
    command = typer.main.get_command(app)
    interrupted: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupted.append(number)
        signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, interrupt)
    try:
        status = command.main(prog_name="cape", standalone_mode=False)
    except UserError as error:
        # What is interrupted along with this process, such as a viewer, may fail before this one takes notice.
        status = 130 if interrupted else _refuse(error.at_command_line)
    except TyperException as error:
        status = _refuse(f"{error.format_message()} (cape --help tells what there is)")
    except BrokenPipeError:
        status = 1
    except typer.Abort:
        status = 130
    except Exception:
        # An interrupt while numba compiles comes out as whatever broke in the compiler.
        if not interrupted:
            raise
        status = 130
    finally:
        telling.close()
    sys.exit(status if isinstance(status, int) else 0)


def _refuse(text: str) -> int:
    from cape.cli.words import shortened

    print("cape: " + shortened(printable(" ".join(text.split()))), file=sys.stderr)
    return 2
