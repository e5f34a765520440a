"""Target sequences computed from input sequences."""
