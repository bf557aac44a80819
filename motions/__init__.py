"""Motion clips: reading, writing, sampling, and the ones that come with the package."""
