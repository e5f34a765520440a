"""Scores, each beside the baselines that it has to beat."""
