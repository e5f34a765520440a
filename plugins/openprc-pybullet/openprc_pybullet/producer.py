"""The producer: importer, runner and recorder behind one name, each loaded when it is used."""

from __future__ import annotations

from openprc_pybullet.importer import Importer


class Producer(Importer):
    """What the record of this plugin loads; see the modules of its parts."""
