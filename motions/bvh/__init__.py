"""The BVH file format: text to numbers and back, in the file's own unit and axes."""
