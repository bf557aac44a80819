"""How good contact is."""
