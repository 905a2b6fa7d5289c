"""Meshes and their level sets."""

import pickle
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


def test_a_level_set_of_a_mesh(cube_mesh):
    part = cube_mesh.level_set(0.1)
    assert part.volume == pytest.approx(8, rel=0.01)
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
