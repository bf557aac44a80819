"""The versions of what the packages build on, that `pyproject.toml` allows."""
