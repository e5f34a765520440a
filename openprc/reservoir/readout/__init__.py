"""Readouts: state matrix to target."""
