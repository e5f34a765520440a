"""An entry module that imports what nobody needs for a listing."""

import scipy.signal  # noqa: F401
from wire_plugin import openprc_producers  # noqa: F401

OPENPRC_PLUGIN_API = "1.0"
