"""Reading states and inputs out of simulation.h5."""
