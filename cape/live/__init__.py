"""Cloth that is simulated as the clock runs, steered by hand and shown as it moves."""
