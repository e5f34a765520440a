"""Mesh series into OpenPRC, trajectories into ParaView.

This module is all that is imported to list the plugin, so it imports records and nothing else;
the code that a record names is loaded when it is used.
"""

from openprc.hooks import ExporterSpec, OptionSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"

_STRIDE = OptionSpec("stride", "take every so many frames", kind="int", default=1)
_FIELDS = OptionSpec(
    "fields",
    "velocities, observed, strain, ...: what is shown besides the places; none for nothing",
    multiple=True,
    default=(),
)


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
