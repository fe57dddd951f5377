"""tm-sim --paraview: the series as a VTK reader reads it."""
import os
import xml.etree.ElementTree as xml

import numpy as np
import pytest
from kit import NETWORK
from simkit import block_scene, report, run

TYPES = {"Float64": "<f8", "Int32": "<i4", "Int64": "<i8", "UInt8": "<u1"}


def read_vtu(path):
    """Returns {array's name: values}; finds every appended array by the offset in its XML."""
    data = path.read_bytes()
    mark = data.index(b'<AppendedData encoding="raw">')
    begin = data.index(b"_", mark) + 1
    end = data.rindex(b"\n</AppendedData>")
    root = xml.fromstring(data[:mark] + b"</VTKFile>")
    assert root.get("type") == "UnstructuredGrid" and root.get("byte_order") == "LittleEndian" and root.get("header_type") == "UInt64"
    piece = root.find("UnstructuredGrid/Piece")
    tuples = {"Points": "NumberOfPoints", "PointData": "NumberOfPoints", "Cells": "NumberOfCells", "CellData": "NumberOfCells"}
    out, used = {}, 0
    for section, count in tuples.items():
        for array in piece.find(section):
            at = begin + int(array.get("offset"))
            size = int(np.frombuffer(data, "<u8", 1, at)[0])
            values = np.frombuffer(data[at + 8:at + 8 + size], TYPES[array.get("type")])
            rows = int(piece.get(count)) * (4 if array.get("Name") == "connectivity" else 1)
            assert len(values) == rows * int(array.get("NumberOfComponents")), array.attrib
            out[array.get("Name")] = values.reshape(rows, -1).squeeze()
            used += 8 + size
    assert begin + used == end, "bytes that no array names, or too few"
    for array in root.find("UnstructuredGrid/FieldData"):
        out[array.get("Name")] = np.array(array.text.split(), float).reshape(int(array.get("NumberOfTuples")), -1)
    return out


def read_series(folder):
    index = xml.parse(folder / "run.pvd").getroot()
    assert index.get("type") == "Collection"
    return [(float(d.get("timestep")), read_vtu(folder / d.get("file"))) for d in index.find("Collection")]


def boundary(tet):
    """Returns the faces that belong to one tetrahedron only."""
    faces = np.sort(np.concatenate([tet[:, [1, 2, 3]], tet[:, [0, 2, 3]], tet[:, [0, 1, 3]], tet[:, [0, 1, 2]]]), axis=1)
    unique, count = np.unique(faces, axis=0, return_counts=True)
    return unique[count == 1]


def test_a_lockstep_run_frame_by_frame(bin, root, tmp_path):
    """Times, displacements compared with the snapshot that --settle writes of the same mesh, cut tetrahedra, the tool."""
    scene = block_scene(tmp_path, root, "gravity:\ndamping: {rate: 60 /s}\ntime: {frame_rate: 25 Hz, duration: 2 s}\n")
    run(bin / "tm-sim", scene, "--lockstep", "--paraview", tmp_path / "series", "--paraview-every", 5)
    series = read_series(tmp_path / "series")
    assert [t for t, _ in series] == pytest.approx([0.2 * k for k in range(11)], abs=1e-9)
    assert sorted(os.listdir(tmp_path / "series")) == [f"frame_{k:06d}.vtu" for k in range(11)] + ["run.pvd"]
    first, last = series[0][1], series[-1][1]
    assert (first["displacement_m"] == 0).all() and last["TimeValue"][0] == pytest.approx(2)
    assert (first["types"] == 10).all() and (first["offsets"] == 4 * np.arange(1, len(first["offsets"]) + 1)).all()
    corner = first["Points"][first["connectivity"].reshape(-1, 4)]
    volume = np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6
    assert (volume > 0).all() and volume.sum() == pytest.approx(np.prod(np.ptp(first["Points"], axis=0)))
    run(bin / "tm-sim", scene, "--settle", "1e-9", "--write", tmp_path / "rest.csv")
    rest = np.loadtxt(tmp_path / "rest.csv", delimiter=",", skiprows=1)
    assert np.abs(last["Points"] - rest[:, 1:4]).max() < 1e-12
    assert np.abs(last["displacement_m"] - rest[:, 4:7]).max() < 0.02 * np.abs(rest[:, 4:7]).max()
    assert (last["alive"] == 1).all() and (last["vtkGhostType"] == 0).all() and set(last["region"]) == {0}


@pytest.mark.parametrize("model", ["dynamic", "hybrid"])
def test_removed_tetrahedra_are_marked_and_hidden(bin, root, tmp_path, model):
    more = [] if model == "dynamic" else ["--set", "model=hybrid", "--set", "hybrid.box={min: [30 mm, 0 mm, 15 mm], max: [90 mm, 100 mm, 51 mm]}"]
    scene = root / "apps/scenes/block-cut.yaml"
    said = report(bin / "tm-sim", scene, *more, "--unset", "haptics", "--lockstep", "--paraview", tmp_path / "series", "--paraview-every", 10, tmp=tmp_path)
    alive = [f["alive"].sum() for _, f in read_series(tmp_path / "series")]
    last = read_series(tmp_path / "series")[-1][1]
    assert alive[0] == said["tets"] and alive[-1] == said["tets_alive"] < said["tets"] and alive == sorted(alive, reverse=True)
    assert ((last["vtkGhostType"] == 32) == (last["alive"] == 0)).all()
    tet = last["connectivity"].reshape(-1, 4)
    assert len(boundary(tet[last["alive"] == 1])) != len(boundary(tet))
    assert last["tip_m"].shape == last["force_N"].shape == (2, 3) and np.isfinite(last["force_N"]).all()


def test_a_run_in_real_time(bin, build, root, tmp_path):
    """In real time frames are written when the clock permits, in the same format."""
    scene = block_scene(tmp_path, root, "gravity:\ndamping: {rate: 60 /s}\nrendering:\ntime: {frame_rate: 25 Hz}\n")
    run(*NETWORK, bin / "tm-sim", scene, "--realtime", "--frames", 20, "--paraview", tmp_path / "series")
    series = read_series(tmp_path / "series")
    times = [t for t, _ in series]
    assert len(series) == 21 and times == sorted(times) and times[0] == 0 and len(set(times)) == 21
    assert np.abs(series[-1][1]["displacement_m"]).max() > 1e-4


@pytest.mark.parametrize("arguments, says", [
    (["--settle", "1e-6", "--paraview", "s"], "goes with --lockstep or --realtime"),
    (["--lockstep", "--paraview", "no/such/folder"], "cannot be made"),
    (["--lockstep", "--paraview", "scene.yaml"], "scene.yaml"),
    (["--lockstep", "--paraview", "s", "--paraview-every", "0"], "below 1"),
    (["--lockstep", "--paraview", "s", "--paraview-every", "1.5"], "whole number"),
])
def test_bad_use(bin, root, tmp_path, arguments, says):
    scene = block_scene(tmp_path, root)
    _, err = run(bin / "tm-sim", scene, *arguments, code=2, cwd=tmp_path)
    assert says in err
    assert os.listdir(tmp_path) == ["scene.yaml"]


def test_fibres_are_in_both_files(bin, root, tmp_path):
    """A unit vector per tetrahedron, in the order of the scene's table; no array if the scene has no fibres."""
    scene = root / "apps/scenes/cylinder-fibre.yaml"
    wanted = np.loadtxt(root / "meshes/cylinder_1k.fibres.csv", delimiter=",", comments="#", skiprows=1)[:, -3:]
    wanted /= np.linalg.norm(wanted, axis=1)[:, None]
    run(bin / "tm-sim", scene, "--lockstep", "--duration", "0.04", "--paraview", tmp_path / "series")
    run(bin / "tm-sim", scene, "--settle", "1e-6", "--write", tmp_path / "rest.vtk")
    words = (tmp_path / "rest.vtk").read_text().split()
    at = words.index("fibre")
    assert words[at - 1:at + 2] == ["VECTORS", "fibre", "double"]
    settled = np.array(words[at + 2:at + 2 + wanted.size], float).reshape(-1, 3)
    for found in (settled, *(frame["fibre"] for _, frame in read_series(tmp_path / "series"))):
        assert found.shape == wanted.shape and np.abs(found - wanted).max() < 1e-12
    plain = block_scene(tmp_path, root, "time: {duration: 0.04 s}\n")
    run(bin / "tm-sim", plain, "--lockstep", "--paraview", tmp_path / "plain")
    run(bin / "tm-sim", plain, "--settle", "1e-6", "--write", tmp_path / "plain.vtk")
    assert "fibre" not in read_series(tmp_path / "plain")[0][1] and "fibre" not in (tmp_path / "plain.vtk").read_text()
