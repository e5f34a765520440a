"""From pixels to lengths."""
