"""Clips whose motion is known exactly."""
