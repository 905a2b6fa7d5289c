"""The interface as a typed program uses it; checked by mypy --strict against the package's types."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import druse


def radius(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    lengths: npt.NDArray[np.float64] = np.linalg.norm(points, axis=1) - 4.0
    return lengths


def show(stage: str, done: int, total: int | None) -> None:
    del stage, done, total


def main() -> float:
    cell = druse.Cell.surface("schwarz_p", element="hex").with_volume_fraction(0.3)
    tiling = druse.Tiling(druse.Scaffold.box([10, 10, 10], [2, 2, 2]), cell)
    part: druse.LevelSet = tiling.level_set(voxel_size=0.25, progress=show)
    ball = druse.LevelSet.from_function(radius, [[-4, -4, -4], [4, 4, 4]], 0.25)
    vertices, faces = part.union(ball).dilate(0.1).mesh()
    origins, values, active = part.leaves()
    assert origins.dtype == np.int32 and values.dtype == np.float32 and active.dtype == np.bool_
    report = druse.run({"druse": 1, "band": {"voxel_size": 0.5}}).report
    try:
        druse.Recipe("none.toml")
    except druse.RecipeError as error:
        line: int | None = error.line
        assert line is None
    return part.volume + float(len(vertices) + len(faces)) + float(report is not None)
