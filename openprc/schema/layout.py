"""The trajectory contract as one table.

The writer's checks, the validator, the generated page ``docs/simulation-h5.md`` and the tests
are all read from `DATASETS` and `ATTRIBUTES`. Letters in a shape: T frames, N nodes,
D dimensions, E elements, C columns, K symbols, k nodes of an element or values of a quantity.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

SCHEMA_VERSION = "1.0"
SCHEMA_MAJOR = 1

#: What ``kind`` may say: all files of the package share one envelope.
KINDS = ("trajectory", "readout", "metrics", "optimization")
STATUSES = ("running", "complete", "interrupted", "failed")

#: Attribute with the checksum of everything that grows with time.
CHECKSUM = "crc32"
#: Attribute that tells a time series of an extension from its other arrays.
TIME_AXIS = "time_axis"

Need = Literal["required", "conditional", "optional"]


@dataclass(frozen=True, slots=True)
class DatasetRule:
    """One row of the contract. A trailing ``?`` in `shape` marks an axis that may be absent."""

    path: str
    shape: tuple[str, ...]
    dtypes: tuple[str, ...]
    need: Need
    meaning: str
    when: str = ""
    dimension: str = ""
    since: str = "1.0"

    @property
    def pattern(self) -> re.Pattern[str]:
        """Regular expression that matches concrete paths, placeholders as named groups."""
        parts = re.split(r"<(\w+)>", self.path)
        text = "".join(
            rf"(?P<{part}>[^/]+)" if index % 2 else re.escape(part)
            for index, part in enumerate(parts)
        )
        return re.compile(text + r"\Z")


@dataclass(frozen=True, slots=True)
class AttributeRule:
    """One attribute of the object at `owner` (a path or a path pattern of `DATASETS`)."""

    owner: str
    name: str
    type: Literal["str", "int", "float", "strings"]
    need: Need
    meaning: str
    when: str = ""
    choices: tuple[str, ...] = ()
    since: str = "1.0"


_F = ("f8", "f4")
_S = ("str",)

DATASETS: tuple[DatasetRule, ...] = (
    DatasetRule(
        "/committed", (), ("i8",), "required",
        "Number of rows that are safe to read. Equals T once the file is complete.",
    ),
    DatasetRule(
        "/time_series/time", ("T",), ("f8",), "required",
        "Time of every frame, strictly increasing and finite.",
    ),
    DatasetRule(
        "/time_series/nodes/positions", ("T", "N", "D"), _F, "conditional",
        "Node positions. D is what was measured: a planar recording has two columns.",
        when="no channel is present",
    ),
    DatasetRule(
        "/time_series/nodes/velocities", ("T", "N", "D"), _F, "optional",
        "Node velocities at the same instants.",
    ),
    DatasetRule(
        "/time_series/nodes/observed", ("T", "N"), ("u1",), "conditional",
        "0 missing, 1 measured, 2 filled in. Positions are NaN exactly where it is 0.",
        when="one position is NaN",
    ),
    DatasetRule(
        "/time_series/elements/<kind>/<quantity>", ("T", "E", "k?"), _F, "optional",
        "Quantity of every element, such as length, strain and force of bars, or angle and "
        "torque of hinges and bends. The indices stand under /topology/<kind>.",
    ),
    DatasetRule(
        "/time_series/channels/<name>", ("T", "C"), _F, "conditional",
        "Any other sensor: joint angle, strain gauge, contact force, voltage.",
        when="no positions are present",
    ),
    DatasetRule(
        "/time_series/system/<name>", ("T",), _F, "optional",
        "Whole-body quantity such as kinetic_energy, potential_energy, total_energy, work_in "
        "or dissipated.",
    ),
    DatasetRule(
        "/inputs/<name>/value", ("T", "C"), ("f8",), "conditional",
        "What drove the body, on the clock of the file.",
        when="the group /inputs/<name> is present",
    ),
    DatasetRule(
        "/inputs/<name>/sequence", ("K", "C"), ("f8",), "optional",
        "The symbols before they were held or interpolated. Delay and capacity tasks run on "
        "these.",
    ),
    DatasetRule(
        "/topology/nodes/rest", ("N", "D"), _F, "optional", "Positions of the unloaded body.",
        dimension="length",
    ),
    DatasetRule(
        "/topology/nodes/mass", ("N",), _F, "optional", "Nodal masses.", dimension="mass"
    ),
    DatasetRule(
        "/topology/nodes/fixed", ("N",), ("u1",), "optional", "1 where the node cannot move."
    ),
    DatasetRule(
        "/topology/nodes/id", ("N",), ("i8",), "optional",
        "Node numbers of the source, unique.",
    ),
    DatasetRule(
        "/topology/nodes/label", ("N",), _S, "optional",
        "Node names, unique. Comparisons match nodes across producers by them.",
    ),
    DatasetRule(
        "/topology/<kind>/indices", ("E", "k"), ("i4",), "conditional",
        "Nodes of every element, counted from 0: bars k = 2, faces k = 3, bends k = 3 with the "
        "vertex in the middle, hinges k = 4 with the crease first and the two wings after it.",
        when="the group /topology/<kind> is present",
    ),
    DatasetRule(
        "/topology/<kind>/<property>", ("E",), ("f8", "f4", "i4", "u1", "str"), "optional",
        "Constant of every element: rest_length, stiffness, damping, rest_angle, prestress.",
    ),
    DatasetRule(
        "/provenance/inputs", ("n",), ("table",), "required",
        "Every file that was read: role, name (base name only), bytes, sha256.",
    ),
    DatasetRule(
        "/provenance/config", (), _S, "optional", "Settings of the run as sorted JSON."
    ),
    DatasetRule(
        "/provenance/parents", ("n",), _S, "optional",
        "The run_id of every file that this one was derived from.",
    ),
    DatasetRule(
        "/provenance/notes", ("n",), _S, "optional",
        "Remarks of the producer that a reader of the data should know.",
    ),
)  # fmt: skip

_UNIT_OWNERS = (
    "/time_series/nodes/positions",
    "/time_series/nodes/velocities",
    "/time_series/elements/<kind>/<quantity>",
    "/time_series/channels/<name>",
    "/time_series/system/<name>",
    "/inputs/<name>/value",
    "/topology/nodes/rest",
    "/topology/nodes/mass",
)

#: Arrays of an extension; the contract says only how a time series among them is marked.
EXTENSION_SERIES = "/extensions/<distribution>/<name>"

ATTRIBUTES: tuple[AttributeRule, ...] = (
    AttributeRule("/", "openprc_schema", "str", "required", "MAJOR.MINOR of this contract."),
    AttributeRule("/", "kind", "str", "required", "What the file holds.", choices=KINDS),
    AttributeRule("/", "status", "str", "required", "How the run ended.", choices=STATUSES),
    AttributeRule("/", "run_id", "str", "required", "UUID, version 4."),
    AttributeRule("/", "created", "str", "required", "ISO 8601 instant in UTC."),
    AttributeRule("/", "dims", "int", "required", "2, 3, or 0 when there are no positions."),
    AttributeRule("/", "title", "str", "optional", "One line; absent rather than empty."),
    AttributeRule("/", "comment", "str", "optional", "Free text; absent rather than empty."),
    *(
        AttributeRule(row.path, CHECKSUM, "int", "optional",
                      "CRC-32 of the values as little-endian bytes in C order.")
        for row in DATASETS
        if row.shape[:1] == ("T",)
    ),
    AttributeRule("/time_series/time", "unit", "str", "required", "Unit of time, 1 for steps."),
    AttributeRule(
        "/time_series/time", "kind", "str", "required",
        "physical, or pseudo for quasi-static load steps.", choices=("physical", "pseudo"),
    ),
    AttributeRule(
        "/time_series/time", "uniform", "int", "required",
        "1 claims that frame i is at t0 + i dt to within 1e-6 dt.",
    ),
    AttributeRule("/time_series/time", "t0", "float", "conditional", "Time of frame 0.",
                  when="uniform is 1"),
    AttributeRule("/time_series/time", "dt", "float", "conditional", "Time between frames.",
                  when="uniform is 1"),
    AttributeRule("/time_series/nodes/positions", "frame", "str", "required",
                  "Frame of reference: world, image, or a name."),
    AttributeRule("/time_series/nodes/positions", "axes", "strings", "required",
                  "Names of the D axes."),
    AttributeRule("/time_series/channels/<name>", "columns", "strings", "required",
                  "Names of the C columns."),
    AttributeRule("/time_series/channels/<name>", "quantity", "str", "optional",
                  "What was measured."),
    AttributeRule("/inputs/<name>/value", "columns", "strings", "required",
                  "Names of the C columns."),
    AttributeRule("/inputs/<name>/value", "quantity", "str", "required",
                  "What was prescribed: position, force, voltage, ..."),
    AttributeRule("/inputs/<name>/value", "targets", "strings", "required",
                  "What it acted on; may be empty."),
    AttributeRule("/inputs/<name>/sequence", "hold", "float", "required",
                  "Duration of one symbol, in the unit of time."),
    AttributeRule("/inputs/<name>/sequence", "start", "float", "required",
                  "Time at which symbol 0 begins."),
    *(
        rule
        for owner in _UNIT_OWNERS
        for rule in (
            AttributeRule(owner, "unit", "str", "required", "From the closed list."),
            AttributeRule(owner, "si_factor", "float", "required",
                          "Factor to SI; NaN for px and arb."),
        )
    ),
    *(
        AttributeRule("/provenance", name, "str", "required", meaning)
        for name, meaning in (
            ("producer", "What made the data."),
            ("producer_version", "Its version; unknown when it cannot be told."),
            ("plugin", "Distribution of the plugin."),
            ("plugin_version", "Its version."),
            ("openprc_version", "Version of this package."),
            ("python", "Version of the interpreter."),
            ("platform", "Operating system and machine type."),
        )
    ),
    AttributeRule("/provenance", "command", "str", "optional",
                  "What was typed, paths cut down to base names."),
    AttributeRule("/provenance", "seed", "int", "optional", "Seed of the run."),
    AttributeRule("/provenance", "deterministic", "int", "optional",
                  "1 when the same inputs give the same bytes."),
    AttributeRule("/extensions/<distribution>", "version", "str", "conditional",
                  "Version of the extension.", when="the group is present"),
    AttributeRule(EXTENSION_SERIES, TIME_AXIS, "int", "conditional",
                  "0: axis 0 runs over the frames of the file, (T, ...).",
                  when="it is a time series"),
    AttributeRule(EXTENSION_SERIES, CHECKSUM, "int", "optional",
                  "CRC-32 of a time series, as everywhere."),
    AttributeRule(EXTENSION_SERIES, "unit", "str", "optional", "From the closed list."),
    AttributeRule(EXTENSION_SERIES, "si_factor", "float", "optional",
                  "Factor to SI; NaN for px and arb."),
)  # fmt: skip

#: Groups that the contract knows; everything else at the root is a stray.
ROOT_GROUPS = (
    "committed", "time_series", "inputs", "topology", "provenance", "extensions", "vision",
)  # fmt: skip

#: What units may measure where the contract says so.
PHYSICAL_DIMENSIONS: dict[str, tuple[str, ...]] = {
    "/time_series/nodes/positions": ("length", "pixel length", "arbitrary", "number"),
    "/time_series/nodes/velocities": (
        "velocity", "pixel velocity", "arbitrary rate", "arbitrary", "rate",
    ),
    "/topology/nodes/rest": ("length", "pixel length", "arbitrary", "number"),
    "/topology/nodes/mass": ("mass", "arbitrary", "number"),
}  # fmt: skip

#: Number of nodes in an element of the kinds that the contract names.
ELEMENT_ARITY = {"bars": 2, "bends": 3, "faces": 3, "hinges": 4}


def match(path: str) -> tuple[DatasetRule, dict[str, str]] | None:
    """Find the row of the table that a concrete dataset path belongs to.

    Literal paths win over patterns, so ``/topology/nodes/mass`` is not an element kind.
    """
    for rule in DATASETS:
        if rule.path == path:
            return rule, {}
    for rule in DATASETS:
        if "<" in rule.path and (found := rule.pattern.match(path)):
            if found.groupdict().get("kind") == "nodes":
                continue  # nodes are no kind of element
            return rule, found.groupdict()
    return None


def attributes_of(owner: str) -> tuple[AttributeRule, ...]:
    """Return the attribute rules of an owner as it is written in the table."""
    return tuple(rule for rule in ATTRIBUTES if rule.owner == owner)
