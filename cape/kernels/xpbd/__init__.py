"""XPBD."""
