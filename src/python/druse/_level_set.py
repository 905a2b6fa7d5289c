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
from ._arrays import Floats, Progress, box, checked_function, count, finite, half_width_of, log, numeric
from ._arrays import points_of, positive, shaped, vector
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

        Voxels within the half width (in voxels) become active. The solid lies inside the lattice: the outermost values
        are positive. `origin` is the world position of the first value. The logger `druse` warns where values are no
        distances.
        """
        if np.asarray(values).dtype.kind == "b":
            raise ArgumentError("values has the type bool; expected distances, negative inside")
        data = numeric(values, "values", np.float32)
        if data.ndim != 3:
            raise ArgumentError(f"values has the shape {list(data.shape)}; expected [nx, ny, nz]")
        frame = _frame(voxel_size, half_width, origin)
        _check_dense(data, frame[0], frame[1])
        return cls._of(_druse.from_dense(data, frame))

    @classmethod
    def from_function(
        cls,
        function: Callable[[Floats], object],
        bounds: npt.ArrayLike,
        voxel_size: float,
        lipschitz: float = 1.0,
        half_width: float = 3.0,
        progress: Progress | None = None,
        *,
        clip: bool = False,
    ) -> LevelSet:
        """Make a level set of a Python function.

        Parameters
        ----------
        function : callable
            Maps points, float64 [n, 3], to values [n] in world units, negative inside. It is called on blocks of
            points, from several threads, under the interpreter's lock. It may call level sets, meshes and tilings.
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
        clip : bool
            Intersect the solid with the bounds; without it a solid that crosses them is an error.
        """
        checked = checked_function(function, "function")
        corners, size = box(bounds), positive(voxel_size, "voxel_size")
        made, _ = _druse.from_function(
            _clipped(checked, corners) if clip else checked,
            corners,
            size,
            max(positive(lipschitz, "lipschitz"), 1.0 if clip else 0.0),
            half_width_of(half_width),
            progress,
        )
        solid = cls._of(made)
        found = solid.bounds
        # Values need not be distances, so that the box of the solid is known to some voxels.
        beyond = np.maximum(corners[0] - found[0], found[1] - corners[1]).max()
        if not clip and np.isfinite(beyond) and beyond > 2 * size:
            raise ArgumentError(
                f"the solid reaches {beyond:g} beyond bounds; expected bounds around the solid, or clip=True"
            )
        return solid

    def save(
        self,
        path: str | os.PathLike[str],
        grid: str = "surface",
        compression: str = "blosc",
        half: bool = False,
        tags: Mapping[str, str] | None = None,
    ) -> str:
        """Write a .vdb file of one grid and return its content hash.

        `compression` is none, zip or blosc; `half` stores half floats; `tags` are metadata of the file. Meshes are
        written by ``part.mesh().save``.
        """
        if not os.fspath(path).lower().endswith(".vdb"):
            raise ArgumentError(f"path is {os.fspath(path)!r}; expected a name that ends in .vdb")
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
        """Volume of the solid: that of its `mesh`, and of the report of a run."""
        return self._level_set.measures()[0]

    @property
    def area(self) -> float:
        """Area of the surface: that of its `mesh`."""
        return self._level_set.measures()[1]

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
        """Volumes of the connected components of the solid, largest first.

        A component's volume is that of the voxels whose centres lie inside, which is coarser than `volume`.
        """
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

    def __reduce__(self) -> tuple[Any, ...]:
        frame = (self.voxel_size, self.half_width, self.origin)
        return _unpickle, (self.leaves(), frame, self.report)

    def copy(self) -> LevelSet:
        """An independent copy."""
        return LevelSet._of(self._level_set.copy())

    def _apply(self, operation: str, amount: float, iterations: object, progress: Progress | None) -> LevelSet:
        self._level_set.apply(operation, amount, count(iterations, "iterations"), progress)
        return self

    def dilate(self, distance: float, progress: Progress | None = None) -> LevelSet:
        """Move the surface outwards by a distance in world units."""
        if finite(distance, "distance") < 0:
            raise ArgumentError(f"distance is {distance}; expected at least 0: erode moves inwards")
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
        size, width, origin = self._level_set.frame()
        if isinstance(other, LevelSet):
            operand = other._level_set
            own_size, own_width, own_origin = operand.frame()
            is_shifted = bool(np.abs(np.subtract(own_origin, origin)).max() > 1e-6 * size)
            if is_shifted or abs(own_size / size - 1) > 1e-9 or own_width != width:
                operand, taken = operand.resampled(size, width, origin), operand
                self._level_set.combine(operation, operand, progress)
                taken.clear()
                return self
        else:
            mesh = Mesh.of(other)
            if any(origin):
                mesh = Mesh(np.asarray(mesh.vertices) - origin, np.asarray(mesh.faces))
            operand = mesh.level_set(size, width)._level_set
            if any(origin):
                operand.set_origin(origin)
        self._level_set.combine(operation, operand, progress)
        return self

    def union(self, other: Any, progress: Progress | None = None) -> LevelSet:
        """Unite with a level set, which is consumed, or with a mesh that `Mesh.of` converts.

        An operand on other voxels is resampled to those of this level set; so for `intersect` and `subtract`.
        """
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
    return positive(voxel_size, "voxel_size"), half_width_of(half_width), vector(origin, "origin")


def _check_dense(values: npt.NDArray[np.float32], voxel_size: float, half_width: float) -> None:
    """Refuse values on a lattice that bound no solid within it."""
    if not np.isfinite(values).all():
        return  # the extension module names the first one
    for axis in range(3):
        for side in (0, -1):
            face = values.take(side, axis) if values.shape[axis] else values
            if (face < 0).any():
                raise ArgumentError(
                    f"values has negative numbers at the {'upper' if side else 'lower'} end of axis {axis}; "
                    "expected the solid inside the lattice, with positive values around it"
                )
    steps, most = [], 0.0
    for axis in range(3):
        ahead, behind = np.moveaxis(values, axis, 0)[1:], np.moveaxis(values, axis, 0)[:-1]
        crosses = (ahead < 0) != (behind < 0)
        jumps = np.abs(ahead[crosses] - behind[crosses])
        if jumps.size:
            steps.append(float(jumps.mean()) / voxel_size)
            most = max(most, float(jumps.max()) / voxel_size)
    if not steps:
        raise ArgumentError("values has no negative number; expected distances, negative inside")
    if most > 2 * half_width:
        raise ArgumentError(
            f"values change by up to {most:.3g} voxels between neighbours at the surface; expected distances in the "
            "unit of voxel_size"
        )
    slope = max(steps)
    if not 0.3 < slope < 1.5:
        text = f"values change by {slope:.2g} voxels from one voxel to the next at the surface; distances change by 1"
        log(logging.WARNING, "from_dense", [text])


def _clipped(function: Callable[[Floats], Floats], corners: list[list[float]]) -> Callable[[Floats], Floats]:
    """Return the intersection of a function with a box, whose own values are bounds of the distance."""
    low, high = np.array(corners)

    def call(points: Floats) -> Floats:
        beyond = np.maximum(low - points, points - high).max(axis=1)
        clipped: Floats = np.maximum(function(points), beyond)
        return clipped

    return call


def _unpickle(leaves: tuple[Any, ...], frame: tuple[Any, ...], report: dict[str, Any] | None) -> LevelSet:
    made = LevelSet.from_leaves(*leaves, *frame)
    made.report = report
    return made
