"""Entry module of a plugin full of faults, and what each of them trips.

Names are those of the classes in `faulty_importers`, `faulty_runners`, `faulty_recorders` and
`faulty_exporters`; `ODD` are records that are wrong themselves, in front of good code.
"""

from wire_plugin import exporter, producer, recorder, runner

from openprc.hooks import OptionSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"

_EVERY = producer().options

#: Name: what is wrong, the checks that it trips, the fields of the record.
ODD = {
    "NoHelp": ("an option is explained by one word", "SPEC-2",
               {"options": (*_EVERY, OptionSpec("gain", "gain", kind="float"))}),
    "WrongDefault": ("the default of a number is a text", "SPEC-2",
                     {"options": (*_EVERY, OptionSpec("gain", "what values are multiplied by",
                                                      kind="float", default="2"))}),
    "NoInstallLine": ("a package is needed, and nothing says how to get it", "SPEC-4",
                      {"needs": {"import": ("tabnanny",)}}),
    "VagueCitation": ("the citation cannot be found", "SPEC-4", {"citation": "our paper"}),
}  # fmt: skip

IMPORTERS = {
    "NoImport": ("the importer has no import_run()", "SPEC-5 IMPORT-1"),
    "Shy": ("sniff() is 0.3 sure of its own files", "SNIFF-1"),
    "ByName": ("sniff() looks at the name only", "SNIFF-2 SNIFF-3"),
    "AnyVideo": ("sniff() claims other samples", "SNIFF-3"),
    "Clumsy": ("sniff() raises on a missing path", "SNIFF-4"),
    "Caching": ("sniff() writes a cache", "SNIFF-4"),
    "Slow": ("sniff() takes more than a second on a long file", "SNIFF-5"),
    "Refusing": ("import_run() raises KeyError", "IMPORT-1"),
    "Zeros": ("what was not measured becomes 0", "IMPORT-2"),
    "Unsourced": ("a second file is read and not named", "IMPORT-3"),
    "Touching": ("the source is opened for writing", "IMPORT-4 IMPORT-5"),
    "Littering": ("a log is left in the current folder", "IMPORT-5"),
    "Loud": ("importing warns", "IMPORT-6"),
    "AxisSwap": ("(n, 3) is read as (3, n)", "VALUE-1 IMPORT-2"),
    "Millimetres": ("metres are said to be mm", "VALUE-1"),
    "Late": ("times are one frame off", "VALUE-2"),
    "ShiftedDrive": ("the input is one frame off", "VALUE-3"),
    "Degrees": ("degrees are said to be radians", "VALUE-4"),
    "Random": ("chance enters the data", "REPEAT-1 REPEAT-2"),
    "Seeded": ("the order of a set enters the data", "REPEAT-2"),
    "NeedsPackage": ("importing needs a package that `needs` does not name", "LIGHT-3"),
    "Trusting": ("a cut table gives IndexError", "ROBUST-1"),
    "Fragile": ("a flipped bit gives UnicodeDecodeError", "ROBUST-2"),
    "Empty": ("an empty file beside it gives ZeroDivisionError", "ROBUST-3"),
    "Leaving": ("a failed import leaves a file",
                "ROBUST-1 ROBUST-2 ROBUST-3 ROBUST-4 ROBUST-5 ROBUST-6"),
    "Unpickling": ("pickles are loaded", "ROBUST-4"),
    "Following": ("links in HDF5 are followed", "ROBUST-5"),
    "Unpacking": ("archives are unpacked with ../", "ROBUST-5"),
    "Listing": ("a folder gives ValueError", "ROBUST-6"),
    "Opening": ("a file that cannot be opened gives OSError", "ROBUST-7"),
    "Forgetful": ("the symbols are not what drove the body", "VALUE-3 PIPE-1"),
}  # fmt: skip

RUNNERS = {
    "Restless": ("chance enters the motion", "RUN-1 RUN-2"),
    "Deaf": ("progress() is never called", "RUN-2"),
    "Swallowing": ("Ctrl-C is caught", "RUN-2"),
    "Truncating": ("the number of frames is int(duration / dt)", "RUN-3"),
    "Stepped": ("the first row is the state after a step", "RUN-3 PHYS-6 PHYS-7 PHYS-10"),
    "Delayed": ("the recorded input is one frame late", "RUN-4"),
    "Massless": ("masses are not stored", "RUN-5"),
    "Printing": ("a log is written and printed", "RUN-6"),
    "Dragless": ("the drag of nodes is passed over", "RUN-7 PHYS-4 PIPE-2"),
    "Ruthless": ("run() runs what supports() refuses", "RUN-8"),
    "Lettered": ("models() gives a text in place of a tuple of texts", "RUN-9"),
    "Untyped": ("models() returns a list", "RUN-9"),
    "Weaker": ("gravity is 9.5 m/s2", "PHYS-1 PHYS-5"),
    "Stiffer": ("bars are 5 % too stiff", "PHYS-2 PHYS-3 PHYS-9 PHYS-10 PHYS-13"),
    "Undamped": ("dashpots are passed over", "PHYS-3 RUN-7"),
    "Selfish": ("a bar pulls at one end only", "PHYS-6 PHYS-9 PHYS-10 PIPE-2"),
    "Rounded": ("rest lengths are rounded to mm", "PHYS-7"),
    "Softened": ("rigid bars are stiff springs", "PHYS-8"),
    "Linearised": ("bars act along their first direction", "PHYS-5 PHYS-9 PHYS-11 PHYS-12"),
    "Averaged": ("all nodes have the mean mass", "PHYS-6 PHYS-10"),
    "Creased": ("hinges are half as stiff", "PHYS-11"),
    "Bent": ("bends are twice as stiff", "PHYS-12"),
    "Sticky": ("a slight default damping is left on", "PHYS-6 PHYS-9 PHYS-13"),
    "Amnesic": ("the body forgets within a symbol", "PIPE-2"),
}

RECORDERS = {
    "Warning": ("recording warns", "RECORD-1"),
    "Beginless": ("the state before the loop is not recorded",
                  "RECORD-2 VALUE-1 VALUE-2 VALUE-3 VALUE-4"),
    "Unfinished": ("frames are written by a call that a script may forget", "RECORD-3 RECORD-4"),
    "Hoarding": ("frames are written at a good end only", "RECORD-4"),
    "Covering": ("the error of the loop is covered by another", "RECORD-4"),
    "Mirrored": ("x and y are exchanged", "VALUE-1"),
    "Milliseconds": ("times are in ms and said to be in s", "VALUE-2"),
    "Unpushed": ("the input is zero", "VALUE-3"),
    "Doubled": ("the force is twice what it is", "VALUE-4"),
}  # fmt: skip

EXPORTERS = {
    "Choosy": ("gaps give ValueError", "EXPORT-1"),
    "Rounding": ("numbers are written with four digits", "EXPORT-2"),
    "Filling": ("gaps are filled with zeros", "EXPORT-2"),
    "Littering": ("a file is written and not reported", "EXPORT-3"),
    "Chatting": ("the exporter prints", "EXPORT-3"),
}


def odd_record(name):
    return producer(name=f"odd-{name.lower()}", sample="", **ODD[name][2])


def importer_record(name):
    return producer(
        name=f"importer-{name.lower()}", load=f"faulty_importers:{name}", sample=""
    )  # without a sample: theirs would be of one another's format


def runner_record(name):
    return runner(name=f"runner-{name.lower()}", load=f"faulty_runners:{name}")


def recorder_record(name):
    return recorder(name=f"recorder-{name.lower()}", load=f"faulty_recorders:{name}")


def exporter_record(name):
    return exporter(name=f"exporter-{name.lower()}", load=f"faulty_exporters:{name}")


@hookimpl
def openprc_producers():
    return [
        producer(sample=""),  # reads back what the exporters write
        *map(odd_record, ODD),
        *map(importer_record, IMPORTERS),
        *map(runner_record, RUNNERS),
        *map(recorder_record, RECORDERS),
    ]


@hookimpl
def openprc_exporters():
    return list(map(exporter_record, EXPORTERS))
