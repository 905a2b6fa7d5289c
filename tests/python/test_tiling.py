"""Scaffolds and tilings."""

import types

import numpy as np
import pytest

import druse

TAU = 2 * np.pi


def test_a_box_and_its_points(block):
    assert len(block) == 8 and block.volume == pytest.approx(1000)
    elements, places = block.locate([[1, 1, 1], [9, 9, 9], [11, 0, 0]])
    assert elements[2] == -1 and np.isnan(places[2]).all()
    assert places[:2] == pytest.approx(np.array([[-0.3] * 3, [0.3] * 3]))


def test_a_scaffold_of_arrays_and_of_other_packages():
    nodes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    tet = druse.Scaffold(nodes, {"tetra": [[0, 1, 2, 3]]}, {"load": [1, 2, 3, 4]})
    assert tet.volume == pytest.approx(1 / 6) and tet.fields["load"].tolist() == [1, 2, 3, 4]
    meshio = types.SimpleNamespace(
        points=nodes,
        cells=[
            types.SimpleNamespace(type="triangle", data=np.array([[0, 1, 2]])),
            types.SimpleNamespace(type="tetra", data=np.array([[0, 1, 2, 3]])),
        ],
        point_data={"T": np.arange(4.0)},
        cell_data={"E": [np.array([1.0]), np.array([7.0])]},
    )
    own = druse.Scaffold.of(meshio)
    assert own.volume == pytest.approx(1 / 6) and own.fields["E"].tolist() == [7.0]
    pyvista = types.SimpleNamespace(
        points=nodes,
        offset=np.array([0, 4]),
        cell_connectivity=np.array([0, 1, 2, 3]),
        celltypes=np.array([10], dtype=np.uint8),
        point_data={},
        cell_data={"name": np.array(["a"])},
    )
    assert druse.Scaffold.of(pyvista).volume == pytest.approx(1 / 6)


def test_distances_against_the_formula(block, schwarz):
    tiling = druse.Tiling(block, schwarz, distance="exact")
    points = np.random.default_rng(1).uniform(0.5, 9.5, (2000, 3))
    value = np.cos(TAU * (points / 5 - 0.5)).sum(axis=1)
    slope = np.linalg.norm(TAU / 5 * np.sin(TAU * (points / 5 - 0.5)), axis=1)
    distance = tiling.distance(points, half_width=1.0)
    assert (np.sign(distance) == np.sign(value)).all()
    near = np.abs(value) < 0.05
    assert np.abs(distance[near] - value[near] / slope[near]).max() < 0.01
    assert tiling.distance([2.5, 2.5, 2.5]).shape == ()


def test_the_level_set_has_the_volume_fraction(block, schwarz):
    part = druse.Tiling(block, schwarz, volume_fraction=0.3).level_set(voxel_size=0.2)
    assert part.volume == pytest.approx(300, rel=0.01)
    assert part.check()["problems"] == []


def test_gradings_by_number_array_and_function(block, schwarz):
    points = np.random.default_rng(2).uniform(0, 10, (500, 3))
    numbers = [
        druse.Tiling(block, schwarz, volume_fraction=f).distance(points)
        for f in (0.3, np.full(len(block.nodes), 0.3), lambda p: np.full(len(p), 0.3))
    ]
    assert np.array_equal(numbers[0], numbers[1]) and np.array_equal(numbers[0], numbers[2])
    graded = druse.Tiling(block, schwarz, volume_fraction=lambda p: 0.2 + 0.04 * p[:, 0])
    part = graded.level_set(voxel_size=0.25)
    vertices, _ = part.mesh()
    assert part.volume == pytest.approx(400, rel=0.03)
    assert (vertices[:, 0] > 5).sum() > 0


def test_a_blend_has_its_cells_at_its_ends(block, schwarz):
    other = druse.Cell.surface("iwp", element="hex")
    weights = lambda p: np.stack([1 - p[:, 0] / 10, p[:, 0] / 10], axis=1)  # noqa: E731
    blend = druse.Tiling(block, [schwarz, other], weights=weights)
    points = np.random.default_rng(3).uniform(0, 10, (400, 3))
    points[:, 0] = 0.05
    same = np.sign(blend.distance(points)) == np.sign(druse.Tiling(block, schwarz).distance(points))
    assert same.mean() > 0.98


def test_thickness_is_in_world_units(block, schwarz):
    thick = druse.Tiling(block, schwarz.sheet(0.1), thickness=0.9).level_set(voxel_size=0.15)
    thin = druse.Tiling(block, schwarz.sheet(0.1), thickness=0.6).level_set(voxel_size=0.15)
    # Twice the surface area of Schwarz P, 2.345 a^2 per cell, is that of both sides of the sheet.
    area = 8 * 2.345 * 25
    assert thick.volume - thin.volume == pytest.approx(0.3 * area, rel=0.1)


def test_what_does_not_fit_is_refused(block, schwarz):
    tet = druse.Cell.surface("diamond", element="tet")
    with pytest.raises(druse.ArgumentError, match="the cell fills a tet"):
        druse.Tiling(block, tet)
    with pytest.raises(druse.ArgumentError, match="one value for each node"):
        druse.Tiling(block, schwarz, level=[0.0, 1.0])
    with pytest.raises(druse.ArgumentError, match="at most one"):
        druse.Tiling(block, schwarz, level=0.0, thickness=1.0)
    with pytest.raises(druse.ArgumentError, match="at node 3"):
        druse.Tiling(block, schwarz, level=[np.nan if n == 3 else 0.0 for n in range(len(block.nodes))])
    with pytest.raises(druse.ArgumentError, match="distance is"):
        druse.Tiling(block, schwarz, distance="near")
    with pytest.raises(druse.ArgumentError, match="voxel_size"):
        druse.Tiling(block, schwarz).level_set(voxel_size=0)
    with pytest.raises(druse.ArgumentError, match="does not exist|node"):
        druse.Scaffold(np.zeros((3, 3)), {"tetra": [[0, 1, 2, 3]]})
    with pytest.raises(druse.ArgumentError):
        druse.Scaffold(np.zeros((4, 3)), {"tetra": [[0, 1, 2]]})
    with pytest.raises(druse.ArgumentError, match="elements of type"):
        druse.Scaffold(np.zeros((4, 3)), {"line": [[0, 1]]})
