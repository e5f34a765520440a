"""A library of bodies in neutral terms, each with what is known about its motion."""
