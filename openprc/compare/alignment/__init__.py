"""Bringing two files to common nodes, instants, units and axes."""
