"""Takes as other programs read them: a file for each format, found through one registry."""

from cape.exports.registry import FORMATS, Format, export, format_of, may_write, require_format

__all__ = ["FORMATS", "Format", "export", "format_of", "may_write", "require_format"]
