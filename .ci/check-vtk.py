"""Does VTK read our surfaces, lattices and sequences, with arrays and times? Usage: check-vtk.py FILE..."""
import os
import sys
import xml.etree.ElementTree as ET

import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

SURFACE_CELLS = {"organ", "label"}
LATTICE_POINTS = {"displacement_mm", "organ", "severed_springs"}


def read(path):
    reader = vtk.vtkXMLPolyDataReader() if path.endswith(".vtp") else vtk.vtkXMLUnstructuredGridReader()
    problems = []
    reader.AddObserver("ErrorEvent", lambda *_: problems.append("VTK reports an error"))
    reader.SetFileName(path)
    reader.Update()
    return reader.GetOutput(), problems


def arrays(data):
    return {data.GetArrayName(n): data.GetArray(n) for n in range(data.GetNumberOfArrays())}


def part_of(data, chosen):
    """The cells of a surface where `chosen` is true."""
    mask = numpy_to_vtk(chosen.astype("u1"), deep=True)
    mask.SetName("chosen")
    part = vtk.vtkPolyData()
    part.DeepCopy(data)
    part.GetCellData().AddArray(mask)
    threshold = vtk.vtkThreshold()
    threshold.SetInputData(part)
    threshold.SetInputArrayToProcess(0, 0, 0, vtk.vtkDataObject.FIELD_ASSOCIATION_CELLS, "chosen")
    threshold.SetLowerThreshold(0.5)
    threshold.SetUpperThreshold(1.5)
    threshold.SetThresholdFunction(vtk.vtkThreshold.THRESHOLD_BETWEEN)
    surface = vtk.vtkGeometryFilter()
    surface.SetInputConnection(threshold.GetOutputPort())
    surface.Update()
    return surface.GetOutput()


def open_edges(data, welded=False):
    """Number of open and non-manifold edges; with `welded` after points at one place have become one."""
    if welded:
        clean = vtk.vtkCleanPolyData()
        clean.SetInputData(data)
        clean.SetTolerance(0.0)
        clean.Update()
        data = clean.GetOutput()
    edges = vtk.vtkFeatureEdges()
    edges.SetInputData(data)
    edges.FeatureEdgesOff()
    edges.ManifoldEdgesOff()
    edges.Update()
    return edges.GetOutput().GetNumberOfCells()


def check(path):
    """Facts about a file, and what is wrong with it."""
    data, wrong = read(path)
    points, cells = arrays(data.GetPointData()), arrays(data.GetCellData())
    field = data.GetFieldData()
    if data.GetNumberOfPoints() == 0 or data.GetNumberOfCells() == 0:
        wrong.append("nothing in it")
    for name in ["unit", "space", "organ_names", "TimeValue"]:
        if field.GetAbstractArray(name) is None:
            wrong.append(f"no field data {name}")
    for name, array in {**points, **cells}.items():
        if not all(map(lambda x: x == x and abs(x) < 1e30, vtk_to_numpy(array).ravel()[:100000])):
            wrong.append(f"{name} is not finite")
    if path.endswith(".vtp") and {"inside", "outside"} <= set(cells):
        # Shared walls: every organ is what a threshold of either side picks out.
        wanted, found = set(), set(cells)
        sides = [vtk_to_numpy(cells[name]) for name in ("inside", "outside")]
        names = field.GetAbstractArray("region_names")
        for region in range(names.GetNumberOfValues()):
            mine = (sides[0] == region) | (sides[1] == region)
            part = part_of(data, mine)
            if part.GetNumberOfCells() == 0 or open_edges(part, welded=True) > 0:
                wrong.append(f"{names.GetValue(region)} is open or non-manifold")
    elif path.endswith(".vtp"):
        wanted, found = SURFACE_CELLS, set(cells)
        if open_edges(data) > 0:
            wrong.append("open or non-manifold edges")
    else:
        wanted, found = LATTICE_POINTS, set(points)
        if "strain" not in cells or "organ" not in cells:
            wrong.append("cells lack strain or organ")
        if data.GetCell(0).GetCellType() == vtk.VTK_HEXAHEDRON:
            size = vtk.vtkCellSizeFilter()
            size.SetInputData(data)
            size.Update()
            volume = vtk_to_numpy(size.GetOutput().GetCellData().GetArray("Volume"))
            # Cells a blade went through are stretched over the gap between its lips.
            volume = volume[vtk_to_numpy(data.GetCellData().GetArray("severed_springs")) == 0]
            if (volume <= 0).mean() > 0.001:
                wrong.append(f"{(volume <= 0).sum()} cells are turned inside out")
    if not wanted <= found:
        wrong.append(f"lacks {wanted - found}")
    time = vtk_to_numpy(field.GetArray("TimeValue"))[0] if field.GetArray("TimeValue") else None
    return data.GetNumberOfPoints(), data.GetNumberOfCells(), time, wrong


failed = 0
for path in sys.argv[1:]:
    if path.endswith(".pvd"):
        entries = ET.parse(path).getroot().find("Collection").findall("DataSet")
        times, wrong = [float(entry.get("timestep")) for entry in entries], []
        if len(times) < 2 or any(a >= b for a, b in zip(times, times[1:])):
            wrong.append("times do not grow")
        for entry, time in zip(entries, times):
            *_, found, problems = check(os.path.join(os.path.dirname(path), entry.get("file")))
            wrong += problems + ([] if found == time else [f"{entry.get('file')} is of {found} s, listed at {time} s"])
        facts = f"{len(times)} frames, {times[0]} to {times[-1]} s"
    else:
        points, cells, time, wrong = check(path)
        facts = f"{points} points, {cells} cells, at {time} s"
    print(f"{path}: {facts}: {'FAILED ' + ', '.join(wrong) if wrong else 'ok'}")
    failed += bool(wrong)
print(f"{len(sys.argv) - 1 - failed} passed, {failed} failed")
sys.exit(failed > 0)
