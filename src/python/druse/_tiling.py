"""Tilings: cells over all elements of a scaffold."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _druse
from ._arrays import Floats, Progress, half_width_of, numeric, points_of, positive, shaped
from ._cell import Cell
from ._errors import ArgumentError
from ._level_set import LevelSet
from ._metric import MetricTiling, is_metric_sheet, is_round
from ._scaffold import Scaffold

Graded = float | npt.ArrayLike | Callable[[Floats], object]
"""A number, values at the nodes [n], or a function of points [n, 3] with values [n]."""

# Voxels of the default scale along an element, and of the default clamp.
_VOXELS_PER_ELEMENT = 40
_CLAMP_VOXELS = 10


class Tiling:
    """Cells over all elements of a scaffold, as a field of signed distances in the world.

    Parameters
    ----------
    scaffold : Scaffold, or a mesh that `Scaffold.of` converts
        The elements.
    cell : Cell or sequence of Cell
        The cell. Several cells are one for each element shape, or with `weights` the members of a blend.
    level, volume_fraction, thickness : number, array_like [nodes], or callable, optional
        A grading; at most one. Thickness is a full local thickness in world units: of sheets, and of struts and
        plates (`Cell.graph`, `Cell.plates`), it holds in space whatever the elements do to the cell, and struts
        become round beams. A callable is evaluated at the nodes.
    weights : array_like [nodes, cells], or callable, optional
        Weights of the cells of a blend: not negative; they are divided by their sum.
    interpolation : {"linear", "smoothstep"}
        Between the nodes.
    distance : {"fast", "exact"}
        Two Newton steps, or closest points.
    boundary : {"cut", "extend"}
        Whether the solid ends at the outer faces.
    orient : "auto", array_like [3], or dict
        How elements are turned so that cells with less symmetry than their element, such as the gyroid, continue over
        all faces: with their axes along x, y and z as far as the mesh lets them, or with the third one along a vector.
        A dict has the keys of recipes: vectors `toward` and `up`, `mismatch` ("error" or "blend") for faces over which
        no turns make the cells continue, and `width`, the share of an element beside these faces that is blended.

    Raises
    ------
    ArgumentError
        For cells that do not fit the elements or do not continue over their faces.
    """

    def __init__(
        self,
        scaffold: Any,
        cell: Cell | Sequence[Cell],
        *,
        level: Graded | None = None,
        volume_fraction: Graded | None = None,
        thickness: Graded | None = None,
        weights: npt.ArrayLike | Callable[[Floats], object] | None = None,
        interpolation: str = "linear",
        distance: str = "fast",
        boundary: str = "cut",
        orient: str | npt.ArrayLike | Mapping[str, Any] = "auto",
    ) -> None:
        self.scaffold = Scaffold.of(scaffold)
        self.cells: tuple[Cell, ...] = (cell,) if isinstance(cell, Cell) else tuple(cell)
        if not self.cells:
            raise ArgumentError("no cell; expected at least one")
        for own in self.cells:
            if not isinstance(own, Cell):
                raise ArgumentError(f"found {type(own).__name__}; expected cells")
        given = {"level": level, "volume_fraction": volume_fraction, "thickness": thickness}
        gradings = {key: values for key, values in given.items() if values is not None}
        if len(gradings) > 1:
            raise ArgumentError(f"found {' and '.join(gradings)}; expected at most one of them")
        graded = [(key, self._at_nodes(values, key, ())) for key, values in gradings.items()]
        own_weights = None if weights is None else self._at_nodes(weights, "weights", (len(self.cells),))
        words = (interpolation, distance, boundary)
        turning = _turning(orient)
        self._metric: MetricTiling | None = None
        if is_round(self.cells, gradings) or is_metric_sheet(self.cells, gradings):
            # One number stays one, which makes beams without tapers.
            numbers = [(k, float(v[0]) if _is_number(gradings[k]) else v) for k, v in graded]
            self._metric = MetricTiling(
                self.scaffold, self.cells, own_weights, numbers[0] if numbers else None, words, turning
            )
            return
        members = [[c._cell for c in self.cells]] if weights is None else [[c._cell] for c in self.cells]
        if weights is not None and graded and len(members) > 1:
            raise ArgumentError("found weights and a grading; expected one of them, or a single cell")
        self._tiling = _druse.Tiling(
            self.scaffold._scaffold, members, own_weights, graded[0] if graded else None, words, turning
        )

    def _at_nodes(self, values: Any, name: str, trailing: tuple[int, ...]) -> Floats:
        nodes = self.scaffold.nodes
        if callable(values):
            found = numeric(values(np.array(nodes)), f"the value of {name}", np.float64)
        else:
            found = numeric(values, name, np.float64)
            if found.ndim == 0 and not trailing:
                found = np.full(len(nodes), float(found))
        if found.shape != (len(nodes), *trailing):
            raise ArgumentError(
                f"{name} has the shape {list(found.shape)}; expected {[len(nodes), *trailing]}, one value for each node"
            )
        if not np.isfinite(found).all():
            node = int(np.argwhere(~np.isfinite(found))[0][0])
            raise ArgumentError(f"{name} is {found[node]} at node {node}; expected finite numbers")
        return np.ascontiguousarray(found.ravel())

    def distance(
        self, points: npt.ArrayLike, *, half_width: float | None = None, voxel_size: float | None = None
    ) -> Any:
        """Signed distances [...] to the solid at points [..., 3], in world units, negative inside.

        Parameters
        ----------
        points : array_like
            World coordinates.
        half_width : float, optional
            Values are clamped to it; ten voxels when left out.
        voxel_size : float, optional
            The length over which distances blend across faces; a fortieth of the smallest element when left out.
        """
        own, shape = points_of(points)
        size = self._default_voxel_size() if voxel_size is None else positive(voxel_size, "voxel_size")
        clamp = _CLAMP_VOXELS * size if half_width is None else positive(half_width, "half_width")
        if self._metric is not None:
            return shaped(self._metric.distance(own, size, clamp), shape)
        return shaped(self._tiling.distances(own, size, clamp), shape)

    def _default_voxel_size(self) -> float:
        return self.scaffold._scaffold.stretch()[0] / _VOXELS_PER_ELEMENT

    def level_set(self, voxel_size: float, half_width: float = 3.0, progress: Progress | None = None) -> LevelSet:
        """The level set of the solid; `voxel_size` in world units, `half_width` of the band in voxels."""
        size, width = positive(voxel_size, "voxel_size"), half_width_of(half_width)
        if self._metric is not None:
            return self._metric.level_set(size, width, progress)
        return LevelSet._of(self._tiling.level_set(size, width, progress))

    def __repr__(self) -> str:
        return f"druse.Tiling({self.scaffold!r}, {', '.join(repr(c) for c in self.cells)})"


_ORIENT_KEYS = ("toward", "up", "mismatch", "width")


def _turning(orient: Any) -> dict[str, Any]:
    """All keys of `orient` as the recipe has them; without them `mismatch` is "error", the others are None."""
    if isinstance(orient, str):
        if orient != "auto":
            raise ArgumentError(f'orient is {orient!r}; expected "auto", a vector of three numbers, or a dict')
        given: dict[str, Any] = {}
    else:
        given = dict(orient) if isinstance(orient, Mapping) else {"toward": orient}
    for key in given:
        if key not in _ORIENT_KEYS:
            raise ArgumentError(f"orient has the key {key!r}; expected one of {', '.join(_ORIENT_KEYS)}")
    found = {key: given.get(key) for key in _ORIENT_KEYS}
    for key in ("toward", "up"):
        if found[key] is not None:
            found[key] = _direction(found[key], key)
    if found["up"] is not None and found["toward"] is None:
        raise ArgumentError("orient has the key 'up' without 'toward'; expected both or neither")
    found["mismatch"] = "error" if found["mismatch"] is None else found["mismatch"]
    if found["mismatch"] not in ("error", "blend"):
        raise ArgumentError(f"mismatch is {found['mismatch']!r}; expected \"error\" or \"blend\"")
    if found["width"] is not None:
        found["width"] = width = positive(found["width"], "width")
        if width > 1 or found["mismatch"] != "blend":
            raise ArgumentError(f'width is {width}; expected a share above 0 and at most 1, beside mismatch = "blend"')
    return found


def _direction(given: Any, key: str) -> list[float]:
    vector = numeric(given, key, np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise ArgumentError(f"{key} is {given!r}; expected three finite numbers that are not all 0")
    return [float(v) for v in vector]


def _is_number(values: Any) -> bool:
    return not callable(values) and np.ndim(values) == 0
