"""An entry module that computes something."""

import time

from wire_plugin import openprc_producers  # noqa: F401

OPENPRC_PLUGIN_API = "1.0"
_BEGAN = time.process_time()
while time.process_time() - _BEGAN < 0.2:
    pass
