"""Level sets in a narrow band, as OpenVDB holds them."""

from __future__ import annotations

import base64
import json
import logging
import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _druse
from ._arrays import Floats, Progress, box, checked_function, count, finite, log, numeric, points_of, positive
from ._arrays import shaped, vector
from ._child import program
from ._errors import ArgumentError
from ._mesh import Mesh

_LEAF = (8, 8, 8)


class LevelSet:
    """Signed distances in a narrow band of voxels, negative inside.

    Made by `druse.run`, `Tiling.level_set`, `Mesh.level_set`, `LevelSet.read` and the `from_` functions.

    Operations change the level set in place and return it, so that they can be chained. `union`, `intersect` and
    `subtract` consume an operand that is a level set; `copy` keeps one. A level set is also consumed if an operation
    on it fails or is interrupted. The use of a consumed level set raises `ArgumentError`.
    """

    _level_set: _druse.LevelSet
    report: dict[str, Any] | None = None
    """The report of the run that made it."""

    def __init__(self) -> None:
        raise TypeError("level sets are made by druse.run, Tiling.level_set, LevelSet.read and their like")

    @classmethod
    def _of(cls, level_set: _druse.LevelSet) -> LevelSet:
        made = cls.__new__(cls)
        made._level_set = level_set
        return made

    @classmethod
    def read(
        cls, path: str | os.PathLike[str], grid: str | None = None, value: float | None = None, invert: bool = False
    ) -> LevelSet:
        """Read a grid of a .vdb file.

        A child process reads the file within limits of memory and time, so that a damaged file cannot crash this one.

        Parameters
        ----------
        path : path
            The file.
        grid : str, optional
            The grid; `surface` or the only one when left out.
        value : float, optional
            The value on the surface, for grids that are no level sets.
        invert : bool
            Exchange inside and outside.
        """
        at = None if value is None else finite(value, "value")
        made, notes = _druse.LevelSet.read(os.fspath(path), grid, program(), at, bool(invert))
        log(logging.INFO, os.fspath(path), notes)
        return cls._of(made)

    @classmethod
    def from_leaves(
        cls,
        origins: npt.ArrayLike,
        values: npt.ArrayLike,
        active: npt.ArrayLike,
        voxel_size: float,
        half_width: float = 3.0,
        origin: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> LevelSet:
        """Make a level set of leaves; the arrays are copied into the tree.

        Parameters
        ----------
        origins : array_like, int, shape [n, 3]
            Least voxel of each leaf, multiples of 8.
        values : array_like, float, shape [n, 8, 8, 8]
            Signed distances in world units, within the half width. Of inactive voxels only the sign counts.
        active : array_like, bool, shape [n, 8, 8, 8]
            The voxels of the band.
        voxel_size : float
            World units.
        half_width : float
            Half width of the band, voxels.
        origin : array_like, shape [3]
            World position of voxel (0, 0, 0).
        """
        own = numeric(origins, "origins", np.int32)
        if own.ndim != 2 or own.shape[1] != 3:
            raise ArgumentError(f"origins has the shape {list(own.shape)}; expected [n, 3]")
        data = numeric(values, "values", np.float32)
        mask = np.ascontiguousarray(np.asarray(active))
        if mask.dtype.kind != "b":
            raise ArgumentError(f"active has the type {mask.dtype}; expected booleans")
        for array, name in ((data, "values"), (mask, "active")):
            if array.shape != (len(own), *_LEAF):
                raise ArgumentError(
                    f"{name} has the shape {list(array.shape)}; expected {[len(own), *_LEAF]}"
                )
        frame = _frame(voxel_size, half_width, origin)
        made = _druse.from_leaves(own, data.reshape(-1, 512), mask.reshape(-1, 512), frame)
        return cls._of(made)

    @classmethod
    def from_dense(
        cls,
        values: npt.ArrayLike,
        voxel_size: float,
        half_width: float = 3.0,
        origin: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> LevelSet:
        """Make a level set of distances on a lattice [nx, ny, nz] in world units, negative inside.

        Voxels within the half width (in voxels) become active. The surface lies inside the lattice. `origin` is the
        world position of the first value.
        """
        data = numeric(values, "values", np.float32)
        if data.ndim != 3:
            raise ArgumentError(f"values has the shape {list(data.shape)}; expected [nx, ny, nz]")
        return cls._of(_druse.from_dense(data, _frame(voxel_size, half_width, origin)))

    @classmethod
    def from_function(
        cls,
        function: Callable[[Floats], object],
        bounds: npt.ArrayLike,
        voxel_size: float,
        lipschitz: float = 1.0,
        half_width: float = 3.0,
        progress: Progress | None = None,
    ) -> LevelSet:
        """Make a level set of a Python function.

        Parameters
        ----------
        function : callable
            Maps points, float64 [n, 3], to values [n] in world units, negative inside. It is called on blocks of
            points, from several threads, one at a time.
        bounds : array_like, shape [2, 3]
            Lower and upper corner of a box around the solid.
        voxel_size : float
            World units.
        lipschitz : float
            A bound of the slope: values at two points differ by at most this factor times their distance. It decides
            which voxels are skipped; values are used as they are.
        half_width : float
            Half width of the band, voxels.
        progress : callable, optional
            Called with stage, done and total.
        """
        checked = checked_function(function, "function")
        made, _ = _druse.from_function(
            checked,
            box(bounds),
            positive(voxel_size, "voxel_size"),
            positive(lipschitz, "lipschitz"),
            positive(half_width, "half_width"),
            progress,
        )
        return cls._of(made)

    def save(
        self,
        path: str | os.PathLike[str],
        grid: str = "surface",
        compression: str = "blosc",
        half: bool = False,
        tags: Mapping[str, str] | None = None,
    ) -> str:
        """Write a .vdb file of one grid and return its content hash.

        `compression` is none, zip or blosc; `half` stores half floats; `tags` are metadata of the file.
        """
        pairs = [(str(k), str(v)) for k, v in (tags or {}).items()]
        return self._level_set.save(os.fspath(path), grid, compression, bool(half), pairs)[1]

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel, world units."""
        return self._level_set.frame()[0]

    @property
    def half_width(self) -> float:
        """Half width of the band, voxels."""
        return self._level_set.frame()[1]

    @property
    def origin(self) -> Floats:
        """World position of voxel (0, 0, 0), shape [3]."""
        return np.array(self._level_set.frame()[2])

    @property
    def volume(self) -> float:
        """Volume of the solid."""
        return self._level_set.volume()

    @property
    def area(self) -> float:
        """Area of the surface."""
        return self._level_set.area()

    @property
    def bounds(self) -> Floats:
        """Box around the solid [2, 3]."""
        return np.array(self._level_set.bounds())

    @property
    def info(self) -> dict[str, Any]:
        """Active voxels, leaves, bytes and the like."""
        info: dict[str, Any] = json.loads(self._level_set.info())
        return info

    @property
    def components(self) -> Floats:
        """Volumes of the connected components of the solid, largest first."""
        return np.array(self._level_set.components())

    @property
    def content_hash(self) -> str:
        """BLAKE3 of the grid, as ``druse info`` shows it for the file."""
        return self._level_set.content_hash("surface")

    def check(self) -> dict[str, Any]:
        """Gradients, components and violations of a level set (`problems`, empty for a sound one)."""
        text, problems = self._level_set.check()
        return {**json.loads(text), "problems": problems}

    def leaves(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
        """Origins [n, 3], values [n, 8, 8, 8] and active voxels [n, 8, 8, 8] of the leaves, in order of origin.

        The tree owns its leaves one by one, so that the arrays are copies, made in one pass.
        """
        origins, values, active = self._level_set.leaves()
        return origins, values.reshape(-1, *_LEAF), active.reshape(-1, *_LEAF)

    def __call__(self, points: npt.ArrayLike) -> Any:
        """Values [...] at points [..., 3], float32, trilinear between voxels; plus or minus the background far away."""
        own, shape = points_of(points)
        return shaped(self._level_set.samples(own), shape)

    def voxels(self, indices: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Values [n] at voxels [n, 3]."""
        own = numeric(indices, "indices", np.int32)
        if own.ndim != 2 or own.shape[1] != 3:
            raise ArgumentError(f"indices has the shape {list(own.shape)}; expected [n, 3]")
        return self._level_set.voxels(own)

    def mesh(self) -> Mesh:
        """The surface in triangles: closed, oriented and manifold. ``V, F = part.mesh()``."""
        return Mesh._of(self._level_set.mesh())

    def to_pyvista(self) -> Any:
        """The surface as pyvista.PolyData; needs pyvista."""
        return self.mesh().to_pyvista()

    def copy(self) -> LevelSet:
        """An independent copy."""
        return LevelSet._of(self._level_set.copy())

    def _apply(self, operation: str, amount: float, iterations: object, progress: Progress | None) -> LevelSet:
        self._level_set.apply(operation, amount, count(iterations, "iterations"), progress)
        return self

    def dilate(self, distance: float, progress: Progress | None = None) -> LevelSet:
        """Move the surface outwards by a distance in world units."""
        return self._apply("dilate", finite(distance, "distance"), 0, progress)

    def erode(self, distance: float, progress: Progress | None = None) -> LevelSet:
        """Move the surface inwards."""
        return self._apply("erode", finite(distance, "distance"), 0, progress)

    def open(self, distance: float, progress: Progress | None = None) -> LevelSet:
        """Erode, then dilate: removes parts thinner than twice the distance."""
        return self._apply("open", finite(distance, "distance"), 0, progress)

    def close(self, distance: float, progress: Progress | None = None) -> LevelSet:
        """Dilate, then erode: closes gaps narrower than twice the distance."""
        return self._apply("close", finite(distance, "distance"), 0, progress)

    def gaussian(self, width: int = 1, iterations: int = 1, progress: Progress | None = None) -> LevelSet:
        """Smooth by a Gaussian kernel; width in voxels."""
        return self._apply("gaussian", count(width, "width"), iterations, progress)

    def mean(self, width: int = 1, iterations: int = 1, progress: Progress | None = None) -> LevelSet:
        """Smooth by a mean over a cube; width in voxels."""
        return self._apply("mean", count(width, "width"), iterations, progress)

    def median(self, width: int = 1, iterations: int = 1, progress: Progress | None = None) -> LevelSet:
        """Smooth by a median over a cube; width in voxels."""
        return self._apply("median", count(width, "width"), iterations, progress)

    def laplacian(self, iterations: int = 1, progress: Progress | None = None) -> LevelSet:
        """Smooth by Laplacian flow."""
        return self._apply("laplacian", 0.0, iterations, progress)

    def curvature(self, iterations: int = 1, progress: Progress | None = None) -> LevelSet:
        """Smooth by mean-curvature flow."""
        return self._apply("curvature", 0.0, iterations, progress)

    def renormalise(self, iterations: int = 5, progress: Progress | None = None) -> LevelSet:
        """Restore distances; the surface stays."""
        return self._apply("renormalise", 0.0, iterations, progress)

    def _combine(self, operation: str, other: Any, progress: Progress | None) -> LevelSet:
        if not isinstance(other, LevelSet):
            other = Mesh.of(other).level_set(self.voxel_size, self.half_width)
        self._level_set.combine(operation, other._level_set, progress)
        return self

    def union(self, other: Any, progress: Progress | None = None) -> LevelSet:
        """Unite with a level set, which is consumed, or with a mesh that `Mesh.of` converts."""
        return self._combine("union", other, progress)

    def intersect(self, other: Any, progress: Progress | None = None) -> LevelSet:
        """Keep what lies in both; a level set as operand is consumed."""
        return self._combine("intersect", other, progress)

    def subtract(self, other: Any, progress: Progress | None = None) -> LevelSet:
        """Remove what lies in the operand; a level set as operand is consumed."""
        return self._combine("subtract", other, progress)

    def png(self, width: int = 800, height: int = 640, cut: tuple[int, float] | None = None) -> bytes:
        """A shaded picture as PNG. `cut` is an axis (0, 1, 2) and a position of a section plane."""
        plane = None if cut is None else (count(cut[0], "axis of the cut"), finite(cut[1], "position of the cut"))
        return self._level_set.png(count(width, "width"), count(height, "height"), plane)

    def _repr_png_(self) -> bytes | None:
        return None if self._level_set.is_consumed() else self.png()

    def _repr_html_(self) -> str | None:
        if self._level_set.is_consumed():
            return None
        picture = base64.b64encode(self.png()).decode("ascii")
        return f'<img alt="{self!r}" style="max-width: 100%" src="data:image/png;base64,{picture}">'

    def __repr__(self) -> str:
        if self._level_set.is_consumed():
            return "druse.LevelSet(consumed)"
        active = self.info["active_voxels"]
        return f"druse.LevelSet({active} active voxels of {self.voxel_size:g})"


def _frame(voxel_size: float, half_width: float, origin: npt.ArrayLike) -> tuple[float, float, list[float]]:
    return positive(voxel_size, "voxel_size"), positive(half_width, "half_width"), vector(origin, "origin")
