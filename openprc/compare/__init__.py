"""One body on several simulators: how far apart its runs are, and whether that matters."""
