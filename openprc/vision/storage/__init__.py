"""Results in files: save, load, info."""
