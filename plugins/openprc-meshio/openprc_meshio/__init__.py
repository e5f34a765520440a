"""Mesh series into OpenPRC, trajectories into ParaView.

This module is all that is imported to list the plugin, so it imports records and nothing else;
the code that a record names is loaded when it is used.
"""

from openprc.hooks import ExporterSpec, OptionSpec, ProducerSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"

_STRIDE = OptionSpec("stride", "take every so many frames", kind="int", default=1)
_FIELDS = OptionSpec(
    "fields",
    "velocities, observed, strain, ...: what is shown besides the places; none for nothing",
    multiple=True,
    default=(),
)


@hookimpl
def openprc_producers() -> list[ProducerSpec]:
    """Return the producer ``meshio``."""
    return [
        ProducerSpec(
            name="meshio",
            summary="Series of meshes: XDMF, VTKHDF, PVD, numbered VTU, VTK, Gmsh, Abaqus, ...",
            load="openprc_meshio.importer:MeshSeriesImporter",
            capabilities=("import",),
            suffixes=(".xdmf", ".xmf", ".pvd", ".series", ".vtkhdf", ".vtu", ".vtp", ".vtk",
                      ".msh", ".inp", ".mesh", ".meshb", ".med", ".off", ".ply", ".vol", ".bdf",
                      ".nas", ".su2"),
            dims=(2, 3),
            time=("physical", "pseudo"),
            elements=("nodes", "bars", "faces"),
            options=(
                OptionSpec("unit", "unit of the coordinates: m, mm, um, ...; arb if there is none"),
                OptionSpec("displacement", "field to add to the points; none if they move "
                           "themselves"),
                OptionSpec("velocity", "field of the velocities"),
                OptionSpec("velocity_unit", "their unit; that of the coordinates per second"),
                OptionSpec("dt", "time between two frames, where the files do not say",
                           kind="float"),
                OptionSpec("time_unit", "unit of time; s. 1 for load steps"),
                OptionSpec("ids", "field with the number of every node, where frames list them in "
                           "different order"),
                OptionSpec("channels", "field to keep, NAME or NAME=unit", multiple=True,
                           default=()),
                OptionSpec("edges", "make bars of the edges of faces and solids", kind="bool",
                           default=False),
                OptionSpec("missing", "places that are NaN were not seen", kind="bool",
                           default=False),
                OptionSpec("dims", "2 or 3; without it, 2 where z is 0 everywhere", kind="int"),
                OptionSpec("collection", "temporal collection of an XDMF file that has several"),
                OptionSpec("reader", "package that reads VTU, VTK, Gmsh, ...; the first that is "
                           "installed", choices=("meshlane", "meshio")),
            ),
            sample="openprc_meshio.samples:write_sample",
        )
    ]  # fmt: skip


@hookimpl
def openprc_exporters() -> list[ExporterSpec]:
    """Return the exporters ``xdmf`` and ``vtkhdf``."""
    return [
        ExporterSpec(
            name="xdmf",
            summary="XDMF sidecar for ParaView that points into simulation.h5 and copies nothing",
            load="openprc_meshio.xdmf_export:XdmfExporter",
            suffixes=(".xdmf", ".xmf"),
            options=(_STRIDE, _FIELDS),
        ),
        ExporterSpec(
            name="vtkhdf",
            summary="Temporal VTKHDF for ParaView 5.12 and later, one file with everything in it",
            load="openprc_meshio.vtkhdf_export:VtkhdfExporter",
            suffixes=(".vtkhdf",),
            options=(_STRIDE, _FIELDS),
        ),
    ]
