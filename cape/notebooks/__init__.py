"""Recordings shown where they are made: in a Jupyter notebook."""
