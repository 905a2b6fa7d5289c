"""Meshes and their level sets."""

import pickle
import sys
import types

import numpy as np
import pytest

import druse


def test_measures_of_a_cube(cube_mesh):
    assert cube_mesh.volume == pytest.approx(8) and cube_mesh.area == pytest.approx(24)
    assert cube_mesh.bounds.tolist() == [[0, 0, 0], [2, 2, 2]]
    distances = cube_mesh.distance([[1, 1, 1], [3, 1, 1], [1, 1, 1.75]])
    assert distances == pytest.approx([-1, 1, -0.25])


def test_arrays_are_one_view_closed_to_writing(cube_mesh):
    assert cube_mesh.vertices is cube_mesh.vertices
    vertices, faces = cube_mesh
    assert np.shares_memory(vertices, cube_mesh.vertices) and np.shares_memory(faces, cube_mesh.faces)
    with pytest.raises(ValueError):
        vertices[0, 0] = 1


@pytest.mark.parametrize("name", ["cube.stl", "cube.ply", "cube.obj", "cube.3mf"])
def test_files_hold_the_mesh(cube_mesh, tmp_path, name):
    cube_mesh.save(tmp_path / name)
    again = druse.Mesh.read(tmp_path / name)
    assert again.volume == pytest.approx(8) and len(again.faces) == 12


def test_objects_of_others_are_converted(cube_mesh):
    vertices, faces = cube_mesh
    trimesh = types.SimpleNamespace(vertices=vertices, faces=faces)
    meshio = types.SimpleNamespace(points=vertices, cells_dict={"triangle": faces})
    for mesh in (trimesh, meshio, (vertices, faces)):
        assert druse.Mesh.of(mesh).volume == pytest.approx(8)
    with pytest.raises(druse.ArgumentError, match="expected a Mesh"):
        druse.Mesh.of(3)


class _Surface:
    """The part of a pyvista.PolyData that the conversion uses."""

    regular_faces = property()

    def __init__(self, points, faces):
        self.points, self.faces = points, np.insert(faces, 0, 3, axis=1).ravel()

    def extract_surface(self):
        return self

    def triangulate(self):
        return self


def test_objects_with_quads_and_planes_are_converted(cube_mesh):
    vertices, faces = cube_mesh
    assert druse.Mesh.of(_Surface(np.float32(vertices), faces)).volume == pytest.approx(8)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4]]
    mixed = types.SimpleNamespace(points=vertices, cells_dict={
        "line": np.array([[0, 1]]), "quad": np.array(quads), "triangle": np.array([[1, 5, 7], [1, 7, 3]]),
    })
    assert druse.Mesh.of(mixed).volume == pytest.approx(8)
    plane = types.SimpleNamespace(points=vertices[:4, :2], cells_dict={"triangle": np.array([[0, 1, 3]])})
    assert druse.Mesh.of(plane).vertices[:, 2].tolist() == [0, 0, 0, 0]
    with pytest.raises(druse.ArgumentError, match="expected triangles or quads"):
        druse.Mesh.of(types.SimpleNamespace(points=vertices, cells_dict={"tetra": np.array([[0, 1, 2, 4]])}))


def test_other_packages_get_their_own_objects(cube_mesh, monkeypatch):
    """Stand-ins for trimesh and meshio, which record what they are made of."""
    made = lambda *a, **k: types.SimpleNamespace(arguments=a, **k)  # noqa: E731
    monkeypatch.setitem(sys.modules, "trimesh", types.SimpleNamespace(Trimesh=made))
    monkeypatch.setitem(sys.modules, "meshio", types.SimpleNamespace(Mesh=made))
    vertices, faces = cube_mesh.to_trimesh().arguments
    assert vertices.flags.writeable and np.array_equal(vertices, cube_mesh.vertices) and faces.dtype == np.int64
    points, ((name, rows),) = cube_mesh.to_meshio().arguments
    assert name == "triangle" and np.array_equal(rows, cube_mesh.faces) and len(points) == 8


def test_meshes_of_the_real_packages(cube_mesh):
    trimesh = pytest.importorskip("trimesh")
    assert druse.Mesh.of(trimesh.creation.box((2, 2, 2))).volume == pytest.approx(8)
    assert cube_mesh.to_trimesh().is_watertight and cube_mesh.to_trimesh().volume == pytest.approx(8)
    meshio = pytest.importorskip("meshio")
    again = cube_mesh.to_meshio()
    assert isinstance(again, meshio.Mesh) and druse.Mesh.of(again).volume == pytest.approx(8)
    pyvista = pytest.importorskip("pyvista")
    assert druse.Mesh.of(pyvista.Cube(x_length=2, y_length=2, z_length=2)).volume == pytest.approx(8)
    assert druse.Mesh.of(cube_mesh.to_pyvista()).volume == pytest.approx(8)


def test_pictures_in_notebooks(cube_mesh, schwarz, block):
    for drawn in (cube_mesh, schwarz, block):
        assert drawn._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"


def test_a_level_set_of_a_mesh(cube_mesh):
    part = cube_mesh.level_set(0.1)
    # Edges are cut between voxels.
    assert part.volume == pytest.approx(8, rel=0.02)
    assert part([[1, 1, 0.1]])[0] == pytest.approx(-0.1, abs=1e-5)


def test_meshes_are_pickled(cube_mesh):
    assert pickle.loads(pickle.dumps(cube_mesh)).volume == pytest.approx(8)


def test_a_script_makes_a_crystal():
    garnet = druse.crystal("form cubic [1,1,0]=1")
    assert garnet.volume == pytest.approx(4 * np.sqrt(2))
    with pytest.raises(druse.ArgumentError):
        druse.crystal("no such step")


def test_bad_meshes_are_refused():
    with pytest.raises(druse.ArgumentError, match=r"expected \[n, 3\]"):
        druse.Mesh([[0, 0]], [[0, 0, 0]])
    with pytest.raises(druse.ArgumentError, match="names vertex 7"):
        druse.Mesh(np.zeros((3, 3)), [[0, 1, 7]])
    with pytest.raises(druse.ArgumentError, match="finite"):
        druse.Mesh([[0, 0, np.nan]] * 3, [[0, 1, 2]])
    with pytest.raises(druse.ArgumentError, match="holds -1"):
        druse.Mesh(np.zeros((3, 3)), [[0, 1, -1]])
    with pytest.raises(druse.ArgumentError, match="expected integers"):
        druse.Mesh(np.zeros((3, 3)), [[0.5, 1, 2]])
    with pytest.raises(druse.ArgumentError):
        druse.Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int)).level_set(1.0)
