"""The producer: importer and runner behind one name, each doing its work in modules of its own."""

from __future__ import annotations

from openprc_merlin.importer import Importer
from openprc_merlin.runner import PathRunner


class Producer(Importer, PathRunner):
    """What the record of this plugin loads; see the modules of its parts."""
