"""One scene at several costs: what accuracy is worth, in trajectories and in task scores."""
