"""What can be said of a run before it: stability, cost, and what looks wrong with the scene."""
