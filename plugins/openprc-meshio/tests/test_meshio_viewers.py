"""Exports opened with VTK, the library that ParaView is made of, number by number."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.hooks import export_file
from openprc.schema import Trajectory

vtk = pytest.importorskip("vtk", reason="vtk is not installed: pip install openprc-meshio[viewers]")
from vtk.util.numpy_support import vtk_to_numpy  # noqa: E402
from vtk.util.vtkAlgorithm import VTKPythonAlgorithmBase  # noqa: E402


class Told:
    """What VTK complains about."""

    def __init__(self, reader):
        self.said = []
        for event in ("ErrorEvent", "WarningEvent"):
            reader.AddObserver(event, self._take)

    def _take(self, source, event):
        self.said.append(event)


def opened(path):
    """Return reader, times, and what it complains about."""
    reader = vtk.vtkXdmfReader() if path.suffix == ".xdmf" else vtk.vtkHDFReader()
    told = Told(reader)
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    key = vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    return reader, np.array(reader.GetOutputInformation(0).Get(key)), told


def leaves(data):
    if not data.IsA("vtkCompositeDataSet"):
        return [data]
    found, walk = [], data.NewIterator()
    walk.InitTraversal()
    while not walk.IsDoneWithTraversal():
        found.append(walk.GetCurrentDataObject())
        walk.GoToNextItem()
    return found


def arrays(data):
    return {
        data.GetArrayName(k): vtk_to_numpy(data.GetArray(k))
        for k in range(data.GetNumberOfArrays())
    }


def nodes_of(grid):
    return [
        [grid.GetCell(k).GetPointId(i) for i in range(grid.GetCell(k).GetNumberOfPoints())]
        for k in range(grid.GetNumberOfCells())
    ]


@pytest.mark.parametrize("form", ["xdmf", "vtkhdf"])
@pytest.mark.parametrize(("dims", "stride", "dtype"), [(2, 1, "f4"), (3, 1, "f8"), (3, 3, "f4")])
@pytest.mark.parametrize("kinds", [(True, True), (True, False), (False, True), (False, False)])
def test_vtk_reads_every_number(trajectory, tmp_path, form, dims, kinds, stride, dtype):
    times = np.cumsum([0.0, 0.1, 0.1, 0.25, 0.1, 1.0, 1 / 3, 0.2])
    path = trajectory(
        dims=dims, bars=kinds[0], faces=kinds[1], frames=8, times=times, dtype=dtype, missing=True
    )
    out = export_file(path, tmp_path / f"out.{form}", options={"stride": stride})[0]
    reader, found, told = opened(out)
    with Trajectory(path) as run:
        np.testing.assert_array_equal(found, run.time[::stride])
        places, speeds, marks = run.positions(), run.velocities(), run.observed()
        # First, last, and out of order, as somebody who drags the slider.
        for step in (0, len(found) - 1, 1, len(found) // 2):
            frame = step * stride
            reader.UpdateTimeStep(found[step])
            grids = leaves(reader.GetOutputDataObject(0))
            cells = []
            for grid in grids:
                points = vtk_to_numpy(grid.GetPoints().GetData())
                np.testing.assert_array_equal(points[:, :dims], places[frame])
                if dims == 2:
                    assert (points[:, 2] == 0).all()
                nodal = arrays(grid.GetPointData())
                np.testing.assert_array_equal(nodal["velocities"][:, :dims], speeds[frame])
                np.testing.assert_array_equal(nodal["observed"], marks[frame])
                cells += nodes_of(grid)
            wanted = [row for kind in run.element_kinds for row in run.indices(kind).tolist()]
            assert cells == (wanted or [[0], [1], [2], [3]])
            named = {}
            for grid in grids:
                for name, values in arrays(grid.GetCellData()).items():
                    named.setdefault(name, []).append(values)
            for kind in run.element_kinds:
                for name in run.element_series(kind):
                    values = np.concatenate(named[name])
                    values = values[~np.isnan(values)]
                    np.testing.assert_array_equal(values, run.element(kind, name)[frame])
    assert told.said == []


def test_a_sidecar_in_another_folder(trajectory, tmp_path):
    path = trajectory()
    out = export_file(path, tmp_path / "figures/out.xdmf")[0]
    reader, times, told = opened(out)
    reader.UpdateTimeStep(times[-1])
    with Trajectory(path) as run:
        grid = leaves(reader.GetOutputDataObject(0))[0]
        np.testing.assert_array_equal(vtk_to_numpy(grid.GetPoints().GetData()), run.positions()[-1])
    assert told.said == []


class Moving(VTKPythonAlgorithmBase):
    """A source of VTK's own: a strip that changes with time."""

    def __init__(self, places, kind, *, moving):
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType=kind)
        self.places, self.moving = places, moving

    def RequestInformation(self, request, inputs, outputs):
        info, key = outputs.GetInformationObject(0), vtk.vtkStreamingDemandDrivenPipeline
        times = [0.5 * k for k in range(len(self.places))]
        info.Set(key.TIME_STEPS(), times, len(times))
        info.Set(key.TIME_RANGE(), [times[0], times[-1]], 2)
        return 1

    def RequestData(self, request, inputs, outputs):
        info = outputs.GetInformationObject(0)
        time = info.Get(vtk.vtkStreamingDemandDrivenPipeline.UPDATE_TIME_STEP()) or 0.0
        k = round(time / 0.5)
        grid = vtk.vtkDataObject.GetData(outputs)
        points = vtk.vtkPoints()
        points.SetDataTypeToDouble()
        for place in self.places[k if self.moving else 0]:
            points.InsertNextPoint(place)
        grid.SetPoints(points)
        grid.Allocate(4)
        for code, ids in ((3, [0, 3]), (5, [0, 1, 2]), (5, [0, 2, 3])):
            grid.InsertNextCell(code, len(ids), ids)
        heat = vtk.vtkDoubleArray()
        heat.SetName("heat")
        for value in (1.0, 2.0, 3.0):
            heat.InsertNextValue(value + 10 * k)
        grid.GetCellData().AddArray(heat)
        warp = vtk.vtkDoubleArray()
        warp.SetName("warp")
        warp.SetNumberOfComponents(3)
        for move in self.places[k] - self.places[0]:
            warp.InsertNextTuple(move)
        grid.GetPointData().AddArray(warp)
        grid.GetInformation().Set(vtk.vtkDataObject.DATA_TIME_STEP(), time)
        return 1


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("kind", ["vtkPolyData", "vtkUnstructuredGrid"])
def test_vtkhdf_that_vtk_itself_wrote(tmp_path, load, motion, kind, moving):
    path = tmp_path / "run.vtkhdf"
    source = Moving(motion, kind, moving=moving)
    writer = vtk.vtkHDFWriter()
    writer.SetInputConnection(source.GetOutputPort())
    writer.SetFileName(str(path))
    writer.SetWriteAllTimeSteps(True)
    writer.Write()
    found = load(path, channels=["heat=K"], displacement="none" if moving else "warp").run
    wanted = motion if moving else motion[0] + (motion - motion[0])
    np.testing.assert_array_equal(found.positions(), wanted)
    np.testing.assert_array_equal(found.time, 0.5 * np.arange(len(motion)))
    assert found.indices("bars").tolist() == [[0, 3]]
    assert found.indices("faces").tolist() == [[0, 1, 2], [0, 2, 3]]
    step = np.arange(len(motion))
    np.testing.assert_array_equal(found.element("bars", "heat"), 1 + 10 * step[:, None])
    np.testing.assert_array_equal(found.element("faces", "heat"), [2, 3] + 10 * step[:, None])
