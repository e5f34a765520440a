"""Telling chaos from a difference of models: perturbed twins, and how runs part."""
