"""Tracks as trajectories: gaps, smoothing, signals, resampling."""
