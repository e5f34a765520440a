"""One file a peer; each runs as ``python -m peers.NAME`` in an interpreter that has it."""
