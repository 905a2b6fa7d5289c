"""Cells against closed forms."""

import pickle
import time

import numpy as np
import pytest

import druse

TAU = 2 * np.pi


def schwarz_p(points):
    return np.cos(TAU * points).sum(axis=-1)


def test_values_are_those_of_the_formula(schwarz):
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (1000, 3))
    assert np.abs(schwarz(points) - schwarz_p(points)).max() < 1e-13
    assert np.abs(schwarz(points, exact=False) - schwarz_p(points)).max() < 1e-4


def test_gradients_are_those_of_the_formula(schwarz):
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (100, 3))
    values, gradients = schwarz.evaluate(points, gradient=True)
    assert np.abs(values - schwarz_p(points)).max() < 1e-13
    assert np.abs(gradients + TAU * np.sin(TAU * points)).max() < 1e-11


def test_shapes_follow_the_points(schwarz):
    assert schwarz([0.0, 0.0, 0.0]) == pytest.approx(3.0)
    assert schwarz(np.zeros((4, 5, 3))).shape == (4, 5)
    assert schwarz(np.zeros((0, 3))).shape == (0,)
    values, gradients = schwarz.evaluate(np.zeros((4, 5, 3)), gradient=True)
    assert values.shape == (4, 5) and gradients.shape == (4, 5, 3)


def test_other_types_and_strides_are_converted(schwarz):
    points = np.random.default_rng(3).uniform(-0.5, 0.5, (64, 6))
    assert np.allclose(schwarz(points[::2, ::2]), schwarz_p(points[::2, ::2]))
    assert np.allclose(schwarz(np.asfortranarray(points[:, :3])), schwarz_p(points[:, :3]))
    single = points[:, :3].astype(np.float32)
    assert np.allclose(schwarz(single), schwarz_p(single.astype(float)))
    assert np.allclose(schwarz([[0, 0, 0], [1, 1, 1]]), 3.0)


def test_levels_are_found(schwarz):
    cell = schwarz.with_volume_fraction(0.35)
    assert cell.level == pytest.approx(-0.52501998, abs=1e-6)
    points = np.random.default_rng(4).uniform(-0.5, 0.5, (200_000, 3))
    assert (cell(points) < 0).mean() == pytest.approx(0.35, abs=0.005)
    assert cell.inverted().volume_fraction == pytest.approx(0.65, abs=1e-4)
    assert schwarz.sheet(0.2).solid == "sheet"
    assert schwarz.level == 0.0


def test_coefficients_are_arrays(schwarz):
    k, c = schwarz.coefficients
    assert k.tolist() == [[1, 0, 0]] and c.tolist() == [0.5 + 0j]


def test_a_fit_reports_its_accuracy(tmp_path):
    cell = druse.Cell.graph("bcc", element="hex", radius=0.1, band_limit=5)
    assert cell.report["rms"] < 0.01 and cell.name == "bcc"
    cell.save(tmp_path / "bcc.cell")
    again = druse.Cell.load(tmp_path / "bcc.cell")
    points = np.random.default_rng(5).uniform(-0.5, 0.5, (100, 3))
    assert np.array_equal(again(points), cell(points))


def test_voxels_give_their_function_back():
    axis = np.arange(16) / 16 - 0.5
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    cell = druse.Cell.voxels(schwarz_p(grid))
    points = np.random.default_rng(6).uniform(-0.5, 0.5, (100, 3))
    assert np.abs(cell(points) - schwarz_p(points)).max() < 1e-9
    assert druse.Cell.voxels(schwarz_p(grid) < 0).volume_fraction == pytest.approx(0.5, abs=0.03)


def test_a_mesh_in_memory_is_fitted(cube_mesh):
    half = druse.Mesh((cube_mesh.vertices - 1) * 0.25, cube_mesh.faces)
    cell = druse.fit(half, element="hex", band_limit=6)
    assert cell.volume_fraction == pytest.approx(0.125, rel=0.05)


def test_cells_are_pickled(schwarz):
    cell = schwarz.with_volume_fraction(0.3)
    again = pickle.loads(pickle.dumps(cell))
    assert again == cell and again.level == cell.level and hash(again) == hash(cell)


def test_the_overhead_of_numpy_is_small():
    """A million points: the calls beside the evaluation take a small share of it."""
    cell = druse.Cell.graph("octet", element="hex", radius=0.08, band_limit=6)
    points = np.random.default_rng(7).uniform(-0.5, 0.5, (1_000_000, 3))
    start = time.perf_counter()
    cell(points)
    whole = time.perf_counter() - start
    own, shape = druse._arrays.points_of(points)
    assert np.shares_memory(own, points)
    start = time.perf_counter()
    for _ in range(10):
        druse._arrays.shaped(np.empty(len(points)), druse._arrays.points_of(points)[1])
    overhead = (time.perf_counter() - start) / 10
    print(f"figure: Python: overhead of numpy on 10^6 points {100 * overhead / whole:.3f} %")
    assert overhead < 0.02 * whole
