"""Random calls with bad and good arguments: an exception of the package or a result, never a crash.

The calls run in a child process, whose end by a signal would be a crash. DRUSE_FULL=1 makes 10,000 of them.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import druse

CALLS = 10_000 if os.environ.get("DRUSE_FULL") else 150

numbers = st.one_of(
    st.floats(width=32), st.integers(-(2**40), 2**40), st.sampled_from([0, 1, -1, 0.25, 3, np.nan, np.inf])
)
anything = st.one_of(numbers, st.none(), st.text(max_size=4), st.binary(max_size=4), st.just(object()), st.booleans())
dtypes = st.sampled_from(["f8", "f4", "i4", "i8", "u1", "?", "c16", "O", "U3"])
small = st.integers(0, 9)


@st.composite
def arrays(draw):
    """An array of any type, often of points, often not contiguous."""
    dtype = draw(dtypes)
    shape = tuple(draw(st.lists(small, max_size=4)))
    if draw(st.booleans()):
        shape = (*shape[:1], draw(st.sampled_from([3, 3, 3, 2])))
    if dtype in ("O", "U3"):
        return np.full(shape, draw(anything), dtype=object) if dtype == "O" else np.full(shape, "a")
    array = draw(hnp.arrays(np.dtype(dtype), shape))
    if array.ndim == 0:
        return array
    return draw(st.sampled_from([array, array.T, array[::-1], np.repeat(array, 2, axis=0)[::2]]))


values = st.one_of(arrays(), anything, st.lists(numbers, max_size=4))
name = st.sampled_from(["schwarz_p", "gyroid", "diamond", "", "octet", "x"])
word = st.sampled_from(["hex", "tet", "quad", "ball", "linear", "exact", "extend", ""])
LEAF = np.full((1, 8, 8, 8), 0.5, dtype=np.float32)
CELL = druse.Cell.surface("schwarz_p", element="hex")
BOX = druse.Scaffold.box([2, 2, 2], [1, 1, 1])
TILING = druse.Tiling(BOX, CELL)
SHEET = druse.Cell.surface("schwarz_p", element="hex", solid="sheet", volume_fraction=0.3)
STRUTS = druse.Cell.graph("bcc", element="hex", band_limit=3)
RECIPE = druse.Recipe({
    "druse": 1, "cell": {"a": {"surface": "schwarz_p"}}, "scaffold": {"box": {"size": [2, 2, 2], "cell_size": 2}},
    "tiling": {"cell": "a"}, "band": {"voxel_size": 0.2},
})


class Grid:
    """A grid of pyvista with random arrays."""

    point_data: dict = {}
    cell_data: dict = {}

    def __init__(self, points, offset, types):
        self.points, self.offset, self.celltypes = points, offset, types
        self.cell_connectivity = np.arange(8)


def part():
    return druse.LevelSet.from_function(lambda p: np.linalg.norm(p, axis=1) - 2, [[-2] * 3, [2] * 3], 0.5)


calls = st.one_of(
    st.tuples(st.just(CELL), values),
    st.tuples(st.just(lambda v: CELL.evaluate(v, gradient=True)), values),
    st.tuples(st.just(CELL.with_level), anything),
    st.tuples(st.just(CELL.with_volume_fraction), anything),
    st.tuples(st.just(lambda v, e: druse.Cell.voxels(v, e)), values, word),
    st.tuples(st.just(lambda n, e: druse.Cell.surface(n, element=e)), name, word),
    st.tuples(st.just(lambda f, v: druse.Cell.formula(f, element="hex", band_limit=v)), st.text("xyz+-*()1. ", max_size=6), st.sampled_from([2, 3, np.nan, -1, 1e9, None])),
    st.tuples(st.just(druse.Mesh), values, values),
    st.tuples(st.just(druse.Mesh.of), values),
    st.tuples(st.just(druse.Scaffold), values, st.dictionaries(st.sampled_from(["tetra", "hexahedron", "line"]), values, max_size=2)),
    st.tuples(st.just(druse.Scaffold.box), values, st.one_of(values, st.lists(st.integers(-1, 4), min_size=3, max_size=3)), word),
    st.tuples(st.just(lambda v, w: druse.Tiling(BOX, CELL, level=v, interpolation=w)), values, word),
    st.tuples(st.just(lambda v: druse.Tiling(BOX, CELL, thickness=v)), values),
    st.tuples(st.just(lambda v: druse.Tiling(BOX, [CELL, CELL], weights=v)), values),
    st.tuples(st.just(lambda v, k: druse.Tiling(BOX, SHEET, thickness=v, **k)), values, st.dictionaries(st.sampled_from(["distance", "boundary"]), word, max_size=1)),
    st.tuples(st.just(lambda v: druse.Tiling(BOX, STRUTS, thickness=v).distance([[1, 1, 1]])), values),
    st.tuples(st.just(lambda p, o, t: druse.Scaffold.of(Grid(p, o, t))), values, values, st.one_of(values, st.just([12, 11, 5]))),
    st.tuples(st.just(lambda r, y, v, o: CELL.homogenize(r, young=y, void=v, only=o)), st.sampled_from([8, 8, 9, -1, None, 2.0, np.nan, 2**40, "8"]), st.one_of(anything, st.just(1)), st.one_of(anything, st.just(1e-3)), st.one_of(anything, st.just("conductivity"))),
    st.tuples(st.just(lambda t, f: druse.design(t, volume_fraction=f, band_limit=0.1)), st.one_of(anything, st.dictionaries(st.sampled_from(["maximise", "zener", "x"]), anything)), anything),
    st.tuples(st.just(lambda p: RECIPE.evaluate(p)), values),
    st.tuples(st.just(lambda p, h: TILING.distance(p, half_width=h)), values, anything),
    st.tuples(st.just(lambda v: TILING.level_set(max(v, 0.05) if isinstance(v, float) else v)), anything),
    st.tuples(st.just(lambda o, v, a, h: druse.LevelSet.from_leaves(o, v, a, h)), values, st.one_of(st.just(LEAF), values), st.one_of(st.just(LEAF > 0), values), anything),
    st.tuples(st.just(druse.LevelSet.from_dense), values, anything, anything, values),
    st.tuples(st.just(lambda v, b: druse.LevelSet.from_function(lambda p: v, b, 0.5)), values, st.one_of(values, st.just([[0] * 3, [2] * 3]))),
    st.tuples(st.just(lambda o, v, n: getattr(part(), o)(v, n)), st.sampled_from(["gaussian", "mean", "median"]), st.one_of(small, anything), st.one_of(small, anything)),
    st.tuples(st.just(lambda o, v: getattr(part(), o)(v)), st.sampled_from(["dilate", "erode", "open", "close"]), st.one_of(st.floats(-1, 1), st.sampled_from([np.nan, None, "a"]))),
    st.tuples(st.just(lambda o, v: getattr(part(), o)(v)), st.sampled_from(["union", "intersect", "subtract", "voxels"]), values),
    st.tuples(st.just(lambda v: part()(v)), values),
    st.tuples(st.just(lambda w, h: part().png(w, h)), st.one_of(st.integers(-1, 64), anything), st.integers(0, 64)),
    st.tuples(st.just(druse.run), st.dictionaries(st.sampled_from(["druse", "band", "op", "x", "cell"]), st.one_of(anything, st.dictionaries(st.sampled_from(["voxel_size", "a"]), anything)))),
    st.tuples(st.just(druse.crystal), st.text(max_size=8)),
    st.tuples(st.just(lambda v: druse.fit(v, band_limit=3)), st.one_of(anything, st.just("hypot(x, y) - 0.2"))),
)
# Sizes that are valid but need the machine's whole memory, or time without bound, are no fault.
ACCEPTED = (druse.Error, TypeError, AttributeError)


@settings(max_examples=CALLS, deadline=None, database=None, derandomize=not os.environ.get("DRUSE_FULL"),
          suppress_health_check=list(HealthCheck))
@given(calls)
def random_call(call):
    function, *arguments = call
    try:
        function(*arguments)
    except ACCEPTED as error:
        assert not str(error).startswith("this is a bug"), error


def test_random_calls_never_crash():
    child = subprocess.run([sys.executable, __file__], capture_output=True, text=True, timeout=3600)
    print(child.stdout)
    assert child.returncode == 0, f"exit code {child.returncode}\n{child.stderr[-3000:]}"


if __name__ == "__main__":
    random_call()
    print(f"figure: Python: {CALLS} random calls without a crash")
