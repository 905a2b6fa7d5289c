"""Level sets, against closed forms and through arrays and files."""

import pickle

import numpy as np
import pytest

import druse
from conftest import ball_distance

BALL = 4 / 3 * np.pi


def test_a_ball_of_a_python_function(ball):
    assert ball.volume == pytest.approx(BALL * 64, rel=0.005)
    assert ball.area == pytest.approx(4 * np.pi * 16, rel=0.01)
    assert ball.check()["problems"] == [] and ball.components == pytest.approx([BALL * 64], rel=0.01)
    points = np.random.default_rng(1).normal(size=(300, 3))
    points *= 4.2 / np.linalg.norm(points, axis=1, keepdims=True)
    assert ball(points) == pytest.approx(np.full(300, 0.2), abs=0.01)


def test_voxels_hold_the_values_of_the_function(ball):
    origins, values, active = ball.leaves()
    assert origins.dtype == np.int32 and values.dtype == np.float32 and active.dtype == np.bool_
    index = np.argwhere(active)
    voxels = origins[index[:, 0]] + index[:, 1:]
    assert len(voxels) == ball.info["active_voxels"]
    exact = ball_distance(voxels * 0.25)
    assert np.abs(values[active] - exact).max() < 1e-6
    assert np.array_equal(ball.voxels(voxels), values[active])


def test_culling_by_the_bound_loses_nothing():
    """The same function with a needlessly large bound: the same voxels from more samples."""
    def torus(p):
        return np.hypot(np.hypot(p[:, 0], p[:, 1]) - 3, p[:, 2]) - 1

    bounds = [[-4, -4, -1], [4, 4, 1]]
    hashes = {druse.LevelSet.from_function(torus, bounds, 0.1, lipschitz=l).content_hash for l in (1.0, 4.0)}
    assert len(hashes) == 1
    part = druse.LevelSet.from_function(torus, bounds, 0.1)
    assert part.volume == pytest.approx(2 * np.pi**2 * 3, rel=0.005)


def test_leaves_make_the_level_set_again(ball):
    again = druse.LevelSet.from_leaves(*ball.leaves(), voxel_size=0.25)
    assert again.content_hash == ball.content_hash and again.volume == ball.volume


def test_a_dense_array_makes_a_level_set(ball):
    axis = np.arange(-24, 25) * 0.25
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    dense = druse.LevelSet.from_dense(np.linalg.norm(grid, axis=-1) - 4, 0.25, origin=[-6, -6, -6])
    assert dense.volume == pytest.approx(ball.volume, rel=1e-4)
    assert dense.origin.tolist() == [-6, -6, -6] and dense.check()["problems"] == []
    assert dense([[0, 0, 3.5]])[0] == pytest.approx(-0.5, abs=0.01)


def test_operations_chain_and_change_in_place(ball):
    result = ball.dilate(0.5)
    assert result is ball and ball.volume == pytest.approx(BALL * 4.5**3, rel=0.01)
    assert ball.erode(0.5).gaussian().median(1, 1).volume == pytest.approx(BALL * 64, rel=0.06)
    assert ball.renormalise().close(0.2).open(0.2).mean().laplacian().curvature().volume < BALL * 64 * 1.05


def test_booleans_consume_their_operand(ball):
    other = ball.copy()
    shifted = druse.LevelSet.from_function(
        lambda p: ball_distance(p - [3, 0, 0]), [[-1, -4, -4], [7, 4, 4]], 0.25
    )
    twin = shifted.copy()
    ball.union(shifted)
    lens = np.pi * (4 * 4 + 3) * (2 * 4 - 3) ** 2 / 12
    assert ball.volume == pytest.approx(2 * BALL * 64 - lens, rel=0.01)
    with pytest.raises(druse.ArgumentError, match="consumed"):
        shifted.volume
    with pytest.raises(druse.ArgumentError, match="consumed"):
        ball.union(shifted)
    assert repr(shifted) == "druse.LevelSet(consumed)" and shifted._repr_png_() is None
    assert other.subtract(twin).volume == pytest.approx(BALL * 64 - lens, rel=0.02)
    with pytest.raises(druse.ArgumentError, match="itself"):
        ball.union(ball)
    assert ball.volume > 0


def test_meshes_are_operands(ball, cube_mesh):
    inside, outside = ball.intersect(cube_mesh)([[1, 1, 0.5], [-0.25, 1, 1]])
    assert (inside, outside) == pytest.approx((-0.5, 0.25), abs=0.01)


def test_operands_on_other_voxels_are_resampled(cube_mesh):
    axis = np.arange(0, 33) * 0.25
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    # Voxel (0, 0, 0) lies at a place that no lattice about the origin has.
    dense = druse.LevelSet.from_dense(np.linalg.norm(grid - 4, axis=-1) - 3, 0.25, origin=[-4.1, -4.1, -4.1])
    alone = dense.volume
    assert alone == pytest.approx(BALL * 27, rel=0.01)
    eighth = dense.copy().intersect(druse.Mesh(np.asarray(cube_mesh.vertices) * 4 - 0.1, cube_mesh.faces))
    # The faces lie on planes of voxels, whose edges are rounded by half a voxel.
    assert eighth.volume == pytest.approx(alone / 8, rel=0.04)
    other = druse.LevelSet.from_function(lambda p: ball_distance(p, 1), [[-1] * 3, [1] * 3], 0.2, half_width=4)
    hollow = dense.subtract(other)
    assert hollow.volume == pytest.approx(alone - BALL, rel=0.01) and other._level_set.is_consumed()
    assert hollow.origin.tolist() == [-4.1] * 3


def test_the_volume_is_that_of_the_mesh():
    slab = druse.Mesh.of(_Box([4, 4, 1])).level_set(0.25)
    assert slab.volume == slab.mesh().volume and slab.area == slab.mesh().area
    assert sum(slab.components) == pytest.approx(slab.volume, rel=0.4)


class _Box:
    """A box about the origin, with the attributes of a mesh of trimesh."""

    def __init__(self, size):
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
        quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
        self.vertices = corners * size
        self.faces = np.array([t for q in quads for t in ([q[0], q[1], q[2]], [q[0], q[2], q[3]])])


def test_functions_call_the_package(ball, block, schwarz, cube_mesh):
    tiling = druse.Tiling(block, schwarz)
    inner = [
        ball,
        cube_mesh.distance,
        tiling.distance,
        schwarz,
        lambda p: druse.LevelSet.from_function(lambda q: ball_distance(q, 1), [[-1] * 3, [1] * 3], 0.5)(p),
    ]
    try:
        for threads in (0, 1):
            druse.set_threads(threads)
            for function in inner:
                made = druse.LevelSet.from_function(
                    lambda p, f=function: np.maximum(ball_distance(p, 2), np.asarray(f(p), dtype=float)),
                    [[-2] * 3, [2] * 3], 0.25, lipschitz=8,
                )
                assert 0 <= made.volume <= BALL * 8 * 1.01
    finally:
        druse.set_threads(0)


def test_solids_that_cross_the_bounds(caplog):
    def waves(p):
        return np.cos(p).sum(axis=1)

    bounds = [[0, 0, 0], [6, 4, 4]]
    with pytest.raises(druse.ArgumentError, match="clip=True"):
        druse.LevelSet.from_function(waves, bounds, 0.2, lipschitz=2)
    part = druse.LevelSet.from_function(waves, bounds, 0.2, lipschitz=2, clip=True)
    points = np.random.default_rng(1).uniform(0, 1, (200_000, 3)) * bounds[1]
    share = (waves(points) < 0).mean()
    assert part.volume == pytest.approx(96 * share, rel=0.03)
    assert (part.bounds[0] > -0.2).all() and (part.bounds[1] < np.array(bounds[1]) + 0.2).all()


def test_a_function_gives_a_value_for_each_point():
    with pytest.raises(druse.ArgumentError, match=r"shape \[2\]; expected \[\d+\]"):
        druse.LevelSet.from_function(lambda points: np.zeros(2), [[0] * 3, [1] * 3], 0.2)


def test_dense_arrays_that_are_no_distances(caplog):
    axis = np.arange(20) - 9.5
    ball = np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1), axis=-1) - 6
    make = druse.LevelSet.from_dense
    with pytest.raises(druse.ArgumentError, match="bool"):
        make(ball < 0, 1.0)
    with pytest.raises(druse.ArgumentError, match="unit of voxel_size"):
        make(ball * 1000, 1.0)
    with pytest.raises(druse.ArgumentError, match="no negative"):
        make(np.zeros((5, 5, 5)), 1.0)
    with pytest.raises(druse.ArgumentError, match="lower end of axis 0"):
        make(-ball, 1.0)
    with pytest.raises(druse.ArgumentError, match="lower end of axis 0"):
        make(ball[6:], 1.0)
    with caplog.at_level("WARNING", "druse"):
        made = make(ball / 1000, 1.0)
    assert "distances change by 1" in caplog.text
    assert made.volume == pytest.approx(BALL * 216, rel=0.02)


def test_sizes_have_limits(ball, tmp_path):
    with pytest.raises(druse.ArgumentError, match="half_width"):
        druse.LevelSet.from_function(ball_distance, [[-4] * 3, [4] * 3], 0.25, half_width=1e6)
    with pytest.raises(druse.ArgumentError, match="16384"):
        ball.dilate(1e9)
    with pytest.raises(druse.ArgumentError, match="erode"):
        ball.dilate(-0.3)
    with pytest.raises(druse.ArgumentError, match=".vdb"):
        ball.save(tmp_path / "ball.stl")
    assert ball.volume > 0


def test_a_bad_parameter_leaves_the_level_set(ball):
    before = ball.content_hash
    with pytest.raises(druse.ArgumentError):
        ball.dilate(-1)
    with pytest.raises(druse.ArgumentError):
        ball.gaussian(width=-1)
    with pytest.raises(druse.ArgumentError, match="1 to 64"):
        ball.median(width=45345)
    assert ball.content_hash == before


def test_the_mesh_is_the_surface(ball):
    vertices, faces = ball.mesh()
    assert np.abs(np.linalg.norm(vertices, axis=1) - 4).max() < 0.01
    assert ball.mesh().volume == pytest.approx(BALL * 64, rel=0.005)
    assert vertices.dtype == np.float64 and faces.dtype == np.uint32


def test_files_keep_the_grid(ball, tmp_path):
    written = ball.save(tmp_path / "ball.vdb", tags={"material": "PA12"})
    again = druse.LevelSet.read(tmp_path / "ball.vdb")
    assert again.content_hash == ball.content_hash == written
    assert again.voxel_size == 0.25 and again.half_width == 3
    ball.save(tmp_path / "half.vdb", half=True, compression="zip")
    assert druse.LevelSet.read(tmp_path / "half.vdb").volume == pytest.approx(ball.volume, rel=1e-3)
    whole = (tmp_path / "ball.vdb").read_bytes()
    for bad in (b"no such file" * 100, whole[: len(whole) // 2]):
        (tmp_path / "bad.vdb").write_bytes(bad)
        with pytest.raises(druse.FileError) as caught:
            druse.LevelSet.read(tmp_path / "bad.vdb")
        assert "bad.vdb" in caught.value.file
    with pytest.raises(druse.FileError):
        druse.LevelSet.read(tmp_path / "none.vdb")


def test_level_sets_are_pickled(ball):
    for part in (ball, ball.copy().subtract(ball.copy().dilate(0.5))):  # and one that holds nothing
        again = pickle.loads(pickle.dumps(part))
        assert again.content_hash == part.content_hash and again.volume == part.volume
        assert (again.voxel_size, again.half_width, again.report) == (part.voxel_size, part.half_width, part.report)


def test_pictures_in_notebooks(ball):
    assert ball._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    assert ball._repr_html_().startswith("<img")
    assert ball.png(64, 64, cut=(2, 0.0))[:4] == b"\x89PNG"


def test_functions_that_fail():
    bounds = [[-4, -4, -4], [4, 4, 4]]

    def breaks(points):
        raise ZeroDivisionError("inside")

    with pytest.raises(ZeroDivisionError, match="inside"):
        druse.LevelSet.from_function(breaks, bounds, 0.5)
    with pytest.raises(druse.ArgumentError, match=r"expected \["):
        druse.LevelSet.from_function(lambda p: np.zeros((len(p), 2)), bounds, 0.5)
    with pytest.raises(druse.ArgumentError, match="real numbers"):
        druse.LevelSet.from_function(lambda p: None, bounds, 0.5)
    with pytest.raises(druse.ArgumentError, match="finite"):
        druse.LevelSet.from_function(lambda p: np.full(len(p), np.nan), bounds, 0.5)
    with pytest.raises(druse.ArgumentError, match="expected a function"):
        druse.LevelSet.from_function(3, bounds, 0.5)
    with pytest.raises(druse.ArgumentError, match="lipschitz"):
        druse.LevelSet.from_function(ball_distance, bounds, 0.5, lipschitz=0)
    calls = []

    def breaks_later(points):
        calls.append(len(points))
        if len(calls) > 3:
            raise KeyError("later")
        return ball_distance(points)

    with pytest.raises(KeyError, match="later"):
        druse.LevelSet.from_function(breaks_later, bounds, 0.05)


def test_bad_arrays():
    good = np.full((8, 8, 8), 1.0, dtype=np.float32)
    active = np.ones((1, 8, 8, 8), dtype=bool)
    make = druse.LevelSet.from_leaves
    with pytest.raises(druse.ArgumentError, match="multiples of 8"):
        make([[1, 0, 0]], good[None], active, 1.0)
    with pytest.raises(druse.ArgumentError, match="two leaves"):
        make([[0, 0, 0]] * 2, np.stack([good] * 2), np.concatenate([active] * 2), 1.0)
    with pytest.raises(druse.ArgumentError, match="shape"):
        make([[0, 0, 0]], good, active, 1.0)
    with pytest.raises(druse.ArgumentError, match="booleans"):
        make([[0, 0, 0]], good[None], good[None], 1.0)
    with pytest.raises(druse.ArgumentError):
        make([[0, 0, 0]], good[None] * np.nan, active, 1.0)
    with pytest.raises(druse.ArgumentError):
        make([[0, 0, 0]], good[None] * 100, active, 1.0)
    with pytest.raises(druse.ArgumentError, match="finite"):
        druse.LevelSet.from_dense(np.full((4, 4, 4), np.inf), 1.0)
    with pytest.raises(druse.ArgumentError, match="nx, ny, nz"):
        druse.LevelSet.from_dense(np.zeros((4, 4)), 1.0)
    with pytest.raises(druse.ArgumentError, match="real numbers"):
        druse.LevelSet.from_dense(np.full((4, 4, 4), 1j), 1.0)
