"""The producer: importer, runner and recorder behind one name, each loaded when it is used."""

from __future__ import annotations

from openprc_pybullet.importer import Importer
from openprc_pybullet.recorder import Recorder
from openprc_pybullet.runner import Runner


class Producer(Importer, Recorder, Runner):
    """What the record of this plugin loads; see the modules of its parts."""
