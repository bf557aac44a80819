"""The command `cape`."""

import sys

from motions.errors import UserError


def main() -> None:
    """Run the command; a user's mistake is one line on standard error and exit status 2."""
    import typer
    from typer.exceptions import TyperException

    from cape.cli.app import app

    command = typer.main.get_command(app)
    try:
        status = command.main(prog_name="cape", standalone_mode=False)
    except UserError as error:
        status = _refuse(str(error))
    except TyperException as error:
        status = _refuse(f"{error.format_message()} (cape --help tells what there is)")
    except BrokenPipeError:
        status = 1
    except typer.Abort:
        status = 130
    sys.exit(status if isinstance(status, int) else 0)


def _refuse(text: str) -> int:
    print("cape: " + " ".join(text.split()), file=sys.stderr)
    return 2
