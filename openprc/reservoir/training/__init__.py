"""Splitting, scaling, fitting and scoring."""
