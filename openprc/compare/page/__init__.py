"""A comparison as a self-contained page."""
