"""Points worth following: detectors by name, feature maps, and their cache."""
