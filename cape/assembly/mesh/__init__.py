"""Any triangle mesh: what it resists with, and how that is laid out for the kernels."""
