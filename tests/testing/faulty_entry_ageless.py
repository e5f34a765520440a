"""An entry module that does not say which plugin API it was written for."""

from wire_plugin import openprc_producers  # noqa: F401
