"""Checks that every plugin has to pass, for the test file of its author."""
