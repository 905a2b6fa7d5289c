"""Scaffolds and tilings."""

import pickle
import sys
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
    again = pickle.loads(pickle.dumps(tet))
    assert again.volume == tet.volume and again.fields["load"].tolist() == [1, 2, 3, 4]
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


def test_other_elements_are_left_out_and_voxels_are_hexahedra():
    """A grid of pyvista with a triangle, and a voxel, whose nodes have another order."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 2)], dtype=float)
    grid = types.SimpleNamespace(
        points=corners,
        offset=np.array([0, 3, 11]),
        cell_connectivity=np.array([0, 1, 2, *range(8)]),
        celltypes=np.array([5, 11], dtype=np.uint8),
        point_data={"T": np.arange(8.0)},
        cell_data={"E": np.array([1.0, 7.0])},
    )
    own = druse.Scaffold.of(grid)
    assert len(own) == 1 and own.volume == pytest.approx(2) and own.fields["E"].tolist() == [7]
    with pytest.raises(druse.ArgumentError, match="surface element"):
        druse.Scaffold.of(types.SimpleNamespace(
            points=corners, offset=[0, 3], cell_connectivity=[0, 1, 2], celltypes=[5], point_data={}, cell_data={}
        ))


def test_files_and_surfaces_of_scaffolds(block, tmp_path):
    rows = block.elements[1].reshape(-1, 8)
    fields = {"T": np.arange(len(block.nodes)), "S": np.arange(16.0).reshape(8, 2)}
    druse.Scaffold(block.nodes, {"hexahedron": rows}, fields).save(tmp_path / "block.vtu")
    read = druse.Scaffold.read(tmp_path / "block.vtu")
    # Nodes are numbered as elements use them, fields with them.
    order, own = (np.lexsort(s.nodes.T) for s in (read, block))
    assert np.array_equal(read.nodes[order], block.nodes[own])
    assert np.array_equal(read.fields["T"][order], fields["T"][own])
    assert np.array_equal(read.fields["S_1"], fields["S"][:, 1])
    surface = block.surface()
    assert surface.volume == pytest.approx(1000) and surface.area == pytest.approx(600)


def test_scaffolds_go_to_meshio(block, monkeypatch):
    """A stand-in, which records what it is made of."""
    made = lambda *a, **k: types.SimpleNamespace(points=a[0], blocks=a[1], **k)  # noqa: E731
    monkeypatch.setitem(sys.modules, "meshio", types.SimpleNamespace(Mesh=made))
    own = druse.Scaffold(block.nodes, {"hexahedron": block.elements[1].reshape(-1, 8)}, {"E": np.arange(8)})
    mesh = own.to_meshio()
    ((name, rows),) = mesh.blocks
    assert name == "hexahedron" and np.array_equal(rows.ravel(), block.elements[1])
    assert mesh.cell_data["E"][0].tolist() == list(range(8)) and mesh.point_data == {}


def test_scaffolds_of_the_real_packages(block):
    meshio = pytest.importorskip("meshio")
    made = block.to_meshio()
    assert isinstance(made, meshio.Mesh) and druse.Scaffold.of(made).volume == pytest.approx(1000)
    pyvista = pytest.importorskip("pyvista")
    assert druse.Scaffold.of(block.to_pyvista()).volume == pytest.approx(1000)
    assert druse.Scaffold.of(pyvista.ImageData(dimensions=(3, 3, 3))).volume == pytest.approx(8)


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
    # Edges at the faces of the block are cut between voxels.
    assert part.volume == pytest.approx(300, rel=0.025)
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


def mesh_volume(part):
    vertices, faces = part.mesh()
    triangles = vertices[np.asarray(faces)]
    return np.linalg.det(triangles).sum() / 6


def assert_same_leaves(part, other):
    (origins, values, active), (same, others, masks) = part.leaves(), other.leaves()
    assert np.array_equal(origins, same) and np.array_equal(active, masks)
    assert np.abs(values - others).max() < 1e-6


def test_struts_are_round_beams_of_a_diameter_in_space():
    """An element twice as long along x: the struts stay round."""
    scaffold = druse.Scaffold.box([20, 10, 10], [1, 1, 1])
    axes = druse.Cell.graph("axes", element="hex", radius=0.05, band_limit=5)
    tiling = druse.Tiling(scaffold, axes, thickness=1.5)
    points = np.random.default_rng(5).uniform([2, 4, 4], [7, 6, 6], (400, 3))
    exact = np.hypot(points[:, 1] - 5, points[:, 2] - 5) - 0.75
    assert np.abs(tiling.distance(points, half_width=3.0) - exact).max() < 0.02
    part = tiling.level_set(voxel_size=0.125)
    # Three cylinders of lengths 20, 10 and 10. Pairs share 16/3 r^3 each, all three 8 (2 - sqrt 2) r^3.
    radius = 0.75
    volume = np.pi * radius**2 * 40 - 3 * 16 / 3 * radius**3 + 8 * (2 - np.sqrt(2)) * radius**3
    assert mesh_volume(part) == pytest.approx(volume, rel=0.02)
    again = pickle.loads(pickle.dumps(axes))
    assert druse.Tiling(scaffold, again, thickness=1.5).level_set(voxel_size=0.125).content_hash == part.content_hash
    fitted = druse.Cell.graph("axes", element="hex", radius=0.05, band_limit=5, section="fitted")
    stretched = druse.Tiling(scaffold, fitted, thickness=1.5).distance(points, half_width=3.0)
    assert np.abs(stretched - exact).max() > 0.1


def test_round_beams_and_sheets_are_those_of_a_recipe(block):
    """The same leaves as a run of the same recipe, but for rounding in the arrays of nodes."""
    recipe = {
        "druse": 1,
        "cell": {"a": {"graph": "octet"}},
        "scaffold": {"box": {"size": [10, 10, 10], "cell_size": 5}},
        "tiling": {"cell": "a", "thickness": "0.8 + 0.05 * x"},
        "band": {"voxel_size": 0.2},
    }
    struts = druse.Cell.graph("octet", element="hex", band_limit=4)
    own = druse.Tiling(block, struts, thickness=lambda p: 0.8 + 0.05 * p[:, 0]).level_set(voxel_size=0.2)
    assert own.volume == pytest.approx(druse.run(recipe, brief=True).volume, rel=1e-3)
    recipe["tiling"]["thickness"] = 0.9
    constant = druse.Tiling(block, struts, thickness=0.9).level_set(voxel_size=0.2)
    assert_same_leaves(constant, druse.run(recipe, brief=True))
    recipe["cell"]["a"] = {"surface": "iwp", "element": "hex", "solid": "sheet"}
    sheet = druse.Cell.surface("iwp", element="hex").sheet(0.2)
    walls = druse.Tiling(block, sheet, thickness=0.9).level_set(voxel_size=0.2)
    assert_same_leaves(walls, druse.run(recipe, brief=True))


def test_graded_struts_and_blends_of_graphs(block):
    cells = [druse.Cell.graph(name, element="hex", band_limit=4) for name in ("octet", "bcc")]
    weights = lambda p: np.stack([1 - p[:, 0] / 10, p[:, 0] / 10], axis=1)  # noqa: E731
    blend = druse.Tiling(block, cells, weights=weights, thickness=0.8)
    assert blend.level_set(voxel_size=0.25).volume > 0
    with pytest.raises(druse.ArgumentError, match="without weights"):
        druse.Tiling(block, cells, thickness=0.8)
    thin, thick = (druse.Tiling(block, cells[0], thickness=t).level_set(voxel_size=0.25).volume for t in (0.6, 0.9))
    graded = druse.Tiling(block, cells[0], thickness=lambda p: 0.6 + 0.03 * p[:, 2]).level_set(voxel_size=0.25).volume
    assert thin < graded < thick
    struts = druse.Cell.graph("octet", element="hex", band_limit=4, section="round")
    filled = druse.Tiling(block, struts, volume_fraction=0.25)
    assert mesh_volume(filled.level_set(voxel_size=0.1)) == pytest.approx(250, rel=0.02)
    with pytest.raises(druse.Error, match="thickness"):
        druse.Tiling(block, cells[0], thickness=-1)


def test_thickness_of_sheets_holds_in_stretched_elements(schwarz):
    """An element twice as long along z: the mid-surface lies half a thickness inside the wall everywhere."""
    scaffold = druse.Scaffold.box([8, 8, 16], [1, 1, 1])
    tiling = druse.Tiling(scaffold, schwarz.sheet(0.1), thickness=0.5)
    points, _ = druse.Tiling(scaffold, schwarz).level_set(voxel_size=0.2).mesh()
    inside = points[(np.abs(points - [4, 4, 8]) < [3.5, 3.5, 7.5]).all(axis=1)]
    assert np.abs(tiling.distance(inside, half_width=1.0) + 0.25).max() < 0.05
    assert tiling.level_set(voxel_size=0.2).check()["problems"] == []


def test_recipes_evaluate_points():
    recipe = druse.Recipe({
        "druse": 1,
        "cell": {"a": {"surface": "schwarz_p"}},
        "scaffold": {"box": {"size": [10, 10, 10], "cell_size": 5}},
        "tiling": {"cell": "a"},
        "band": {"voxel_size": 0.2},
    })
    points = np.random.default_rng(6).uniform(0, 10, (4, 25, 3))
    found = recipe.evaluate(points, exact=True)
    exact = np.cos(TAU * (points / 5 - 0.5)).sum(axis=-1)
    assert np.abs(found["phi"] - exact).max() < 1e-12 and found["gradient"].shape == (4, 25, 3)
    assert (found["weights"]["a"] == 1).all() and set(np.unique(found["element"])) <= set(range(9))
    outside = recipe.evaluate([[20.0, 0, 0]])
    assert outside["element"] == [-1] and np.isnan(outside["phi"]).all()
    with pytest.raises(druse.Error, match="scaffold"):
        druse.Recipe({"druse": 1, "band": {"voxel_size": 0.2}}).evaluate([[0, 0, 0]])


def test_a_gyroid_in_a_hollow_sphere_is_mixed_from_its_turns():
    """Three hexes meet along the lines from its corners outwards."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]) - 0.5
    faces = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    unit = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    hexes = np.hstack([faces, faces + 8])
    sphere = druse.Scaffold(np.vstack([2 * unit, 4 * unit]), {"hexahedron": hexes})
    gyroid = druse.Cell.surface("gyroid", element="hex")
    with pytest.raises(druse.Error, match="8 inner edges in 8 lines"):
        druse.Tiling(sphere, gyroid)
    parts = [
        druse.Tiling(sphere, gyroid, orient={"mismatch": "blend", **width}).level_set(voxel_size=0.15)
        for width in ({}, {"width": 1}, {"width": 0.4})
    ]
    # Half of the room between cubes with half diagonals 2 and 4, less a little where turns are mixed.
    half = ((8 / 3**0.5) ** 3 - (4 / 3**0.5) ** 3) / 2
    assert all(part.check()["problems"] == [] and 0.95 < part.volume / half < 1.05 for part in parts)
    sheet = druse.Tiling(sphere, gyroid.sheet(0.2), thickness=0.4, orient={"mismatch": "blend", "width": 0.4})
    assert sheet.level_set(voxel_size=0.15).check()["problems"] == []


def test_orient_takes_the_keys_of_recipes(block):
    gyroid = druse.Cell.surface("gyroid", element="hex")
    points = np.random.default_rng(8).uniform(0.5, 9.5, (200, 3))
    values = lambda orient: druse.Tiling(block, gyroid, orient=orient).distance(points)  # noqa: E731
    assert np.array_equal(values([1, 0, 0]), values({"toward": [1, 0, 0]}))
    assert np.array_equal(values("auto"), values({}))
    assert not np.array_equal(values([1, 0, 0]), values({"toward": [1, 0, 0], "up": [0, 1, 0]}))
    wrong = [
        ("along", "auto"),
        ({"along": [0, 0, 1]}, "toward, up, mismatch, width"),
        ({"toward": [0, 0, 0]}, "not all 0"),
        ({"up": [1, 0, 0]}, "without 'toward'"),
        ({"mismatch": "mix"}, "blend"),
        ({"width": 0.3}, "mismatch"),
        ({"mismatch": "blend", "width": 2}, "at most 1"),
    ]
    for orient, words in wrong:
        with pytest.raises(druse.ArgumentError, match=words):
            druse.Tiling(block, gyroid, orient=orient)


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
