"""Following points from frame to frame, to a known accuracy."""
