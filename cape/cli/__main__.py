"""`python -m cape.cli`: the command `cape`."""

from cape.cli import main

main()
