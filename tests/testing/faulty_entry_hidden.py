"""An entry module whose importer needs a package that its record does not name."""

from wire_plugin import producer

from openprc.hooks import hookimpl

OPENPRC_PLUGIN_API = "1.0"


@hookimpl
def openprc_producers():
    return [producer(load="faulty_importers:NeedsQuietly")]
