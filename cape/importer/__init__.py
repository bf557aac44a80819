"""A file that is opened in the Rerun viewer, played in a cape: `entry` decides which, and calls `run`."""

from cape.importer.run import run

__all__ = ["run"]
