"""The add-on for Blender, a file that stands alone, and how it is handed out."""
