"""Time integrators, one file a scheme. Each runs a whole block of frames in compiled code."""
