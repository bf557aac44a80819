"""Textile tests of the report: their machinery against closed forms."""
