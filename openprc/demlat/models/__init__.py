"""Mechanical models: what the nodes of an experiment feel."""
