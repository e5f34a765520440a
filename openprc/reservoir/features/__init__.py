"""Features: trajectory to state matrix."""
