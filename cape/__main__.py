"""The command line as `python -m cape`, for where no script is on the path."""

from cape.cli import main

main()
