"""Entry module of a plugin that does everything right; what the faults are put into."""

from openprc.hooks import ExporterSpec, OptionSpec, ProducerSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"


def producer(**changes):
    fields = {
        "name": "wire",
        "summary": "A wire in a text table",
        "load": "wire_code:WireImporter",
        "capabilities": ("import",),
        "suffixes": (".wire",),
        "options": (OptionSpec("every", "take every so many rows", kind="int", default=1),),
        "citation": "Nobody et al. 2024, doi:10.1000/182",
        "sample": "wire_code:write_sample",
    }
    return ProducerSpec(**(fields | changes))


def exporter(**changes):
    fields = {
        "name": "wire",
        "summary": "A wire as a text table",
        "load": "wire_code:WireExporter",
        "suffixes": (".wire",),
    }
    return ExporterSpec(**(fields | changes))


def runner(**changes):
    fields = {
        "name": "verlet",
        "summary": "Point masses on springs, by the velocity Verlet method",
        "load": "verlet_code:VerletRunner",
        "capabilities": ("run",),
        "elements": ("nodes", "bars", "hinges", "gravity", "damping"),
    }
    return ProducerSpec(**(fields | changes))


def recorder(**changes):
    fields = {
        "name": "ticker",
        "summary": "Records a loop that counts",
        "load": "ticker_code:TickerRecorder",
        "capabilities": ("record",),
    }
    return ProducerSpec(**(fields | changes))


@hookimpl
def openprc_producers():
    return [producer(), runner(), recorder()]


@hookimpl
def openprc_exporters():
    return [exporter()]
