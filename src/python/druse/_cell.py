"""Unit cells and fits."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _druse
from ._arrays import Floats, Progress, log, numeric, points_of, positive, shaped
from ._errors import ArgumentError
from ._properties import homogenize
from ._toml import table

_LEVEL_KEYS = ("level", "volume_fraction", "thickness", "solid", "invert")


class Cell:
    """A unit cell: a symmetric Fourier series in the reference frame of an element, negative inside.

    Points are Cartesian reference coordinates: the origin is the centroid, edges are 1, those of the tet sqrt(2).
    Made by `Cell.surface`, `Cell.graph`, `Cell.plates`, `Cell.formula`, `Cell.voxels`, `Cell.load` and `druse.fit`.
    Immutable; `with_volume_fraction` and its like return another cell. Cells can be pickled.
    """

    _cell: _druse.Cell

    def __init__(self) -> None:
        raise TypeError("cells are made by Cell.surface, Cell.graph, Cell.load, druse.fit and their like")

    @classmethod
    def _of(cls, cell: _druse.Cell, keys: dict[str, Any] | None = None) -> Cell:
        made = cls.__new__(cls)
        made._cell = cell
        made._keys = keys
        made._facts_cache = None
        return made

    _facts_cache: dict[str, Any] | None
    # The section of struts or plates, from which a tiling makes round beams.
    _keys: dict[str, Any] | None

    @classmethod
    def _make(cls, name: str, source: str | None, progress: Progress | None, keys: dict[str, Any]) -> Cell:
        cell, warnings = _druse.Cell.make(name, source, table(keys), progress)
        log(logging.WARNING, f"cell {name}", warnings)
        is_skeleton = "graph" in keys or "plates" in keys
        return cls._of(cell, {k: v for k, v in keys.items() if v is not None} if is_skeleton else None)

    @classmethod
    def surface(cls, name: str, **keys: Any) -> Cell:
        """A triply periodic surface by name: schwarz_p, diamond, iwp, neovius, f_rd, gyroid, lidinoid, double_gyroid,
        fischer_koch_s, c_y, c_s, split_p.

        `keys` are those of ``[cell.NAME]`` in a recipe, such as ``element="hex"`` or ``volume_fraction=0.3``.
        """
        return cls._make(name, None, None, {"surface": name, **keys})

    @classmethod
    def graph(cls, name: str, **keys: Any) -> Cell:
        """A cell of struts: a name such as octet, bcc or kelvin, or a file; ``radius`` in reference lengths.

        Its values are those of a fitted series. As in recipes, a `Tiling` with a thickness makes round beams of that
        diameter, and so does ``section="round"``; ``section="fitted"`` keeps the series.
        """
        return cls._make(_stem(name), None, None, {"graph": str(name), **keys})

    @classmethod
    def plates(cls, name: str, **keys: Any) -> Cell:
        """A cell of plates: face_plates, sc_plates, bcc_plates, fcc_plates, or a file; for tilings as `graph`."""
        return cls._make(_stem(name), None, None, {"plates": str(name), **keys})

    @classmethod
    def formula(cls, text: str, **keys: Any) -> Cell:
        """A cell fitted to a formula in x, y, z that is negative inside."""
        return cls._make("formula", None, None, {"formula": text, **keys})

    @classmethod
    def voxels(
        cls,
        values: npt.ArrayLike,
        element: str = "hex",
        band_limit: float | None = None,
        progress: Progress | None = None,
    ) -> Cell:
        """A cell fitted to samples over one period.

        Parameters
        ----------
        values : array_like, shape [n, n, n], or [n, n] for planar elements
            Sample j is at j / n - 1/2 along each axis. Numbers are negative inside; of booleans, True is inside.
        element : str
            The reference element.
        band_limit : float, optional
            Greatest frequency kept, in cycles per reference length.
        """
        array = np.asarray(values)
        binary = array.dtype.kind == "b"
        own = numeric(array, "voxels", np.float64)
        limit = None if band_limit is None else positive(band_limit, "band_limit")
        made = _druse.Cell.of_voxels("voxels", element, own.ravel(), list(own.shape), binary, limit, progress)
        return cls._of(made)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Cell:
        """Read a .cell file."""
        return cls._of(_druse.Cell.read(os.fspath(path)))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .cell file; its numbers are exact."""
        self._cell.save(os.fspath(path))

    @property
    def _facts(self) -> dict[str, Any]:
        if self._facts_cache is None:
            self._facts_cache = json.loads(self._cell.to_json())
        return self._facts_cache

    @property
    def name(self) -> str:
        """The display name."""
        return str(self._facts["name"])

    @property
    def element(self) -> str:
        """The reference element: tri, quad, tet, hex, wedge, pyramid or ball."""
        return str(self._facts["element"])

    @property
    def level(self) -> float:
        """The level, in units of the field; of a sheet, half its thickness."""
        return float(self._facts.get("level", 0.0))

    @property
    def solid(self) -> str:
        """The solid side of the level: below, above, sheet or channels."""
        return str(self._facts.get("solid", "below"))

    @property
    def group(self) -> str | None:
        """The group of symmetries, of a single series."""
        group = self._facts.get("group")
        return None if group is None else str(group)

    @property
    def coefficients(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.complex128]]:
        """Frequencies k [n, d] and coefficients [n], one for each orbit, of a cell that is a single series."""
        listed = self._facts.get("coefficients")
        if listed is None:
            raise ArgumentError(
                "the cell is an expression of several series; its file (save) lists the coefficients of each"
            )
        k = np.array([t["k"] for t in listed], dtype=np.int64)
        c = np.array([complex(*t["c"]) for t in listed], dtype=np.complex128)
        return k, c

    @property
    def report(self) -> dict[str, Any] | None:
        """The accuracy of the fit, in reference lengths; None for closed forms."""
        report: dict[str, Any] | None = self._facts.get("report")
        return report

    @property
    def volume_fraction(self) -> float:
        """Share of the element that is solid."""
        return self._cell.volume_fraction()

    @property
    def thickness(self) -> float:
        """Thickness of walls or struts, in reference lengths."""
        return self._cell.thickness()

    def with_level(self, level: float | None = None, **keys: Any) -> Cell:
        """The same function with another level, or with `solid`, `volume_fraction`, `thickness` or `invert`."""
        keys = {**({} if level is None else {"level": level}), **keys}
        for key in keys:
            if key not in _LEVEL_KEYS:
                raise ArgumentError(f"found the key {key!r}; expected one of {', '.join(_LEVEL_KEYS)}")
        made = self._cell.with_level(table(keys))
        if self._keys is None or not set(keys) <= {"volume_fraction", "thickness"}:
            return self._of(made)
        kept = {key: value for key, value in self._keys.items() if key not in _LEVEL_KEYS}
        return self._of(made, {**kept, **keys})

    def with_volume_fraction(self, fraction: float) -> Cell:
        """The same function at the level at which the solid's share of the element is `fraction`."""
        return self.with_level(volume_fraction=fraction)

    def with_thickness(self, thickness: float) -> Cell:
        """The same function at the level at which walls or struts have a thickness, in reference lengths."""
        return self.with_level(thickness=thickness)

    def sheet(self, volume_fraction: float) -> Cell:
        """The sheet around the surface, with a volume fraction."""
        return self.with_level(solid="sheet", volume_fraction=volume_fraction)

    def inverted(self) -> Cell:
        """Solid and void exchanged."""
        return self.with_level(invert=True)

    def __call__(self, points: npt.ArrayLike, exact: bool = True) -> Any:
        """Values [...] at reference points [..., 3], negative inside.

        An array of float64 that is contiguous is not copied. ``exact=False`` evaluates the table that tilings use,
        in single precision, which is faster for fitted cells.
        """
        own, shape = points_of(points)
        return shaped(self._cell.values(own, bool(exact)), shape)

    def evaluate(self, points: npt.ArrayLike, gradient: bool = False) -> Any:
        """Values at reference points; with ``gradient=True`` a pair of values [...] and gradients [..., 3]."""
        if not gradient:
            return self(points)
        own, shape = points_of(points)
        values, gradients = self._cell.values_and_gradients(own)
        return shaped(values, shape), gradients.reshape((*shape, 3))

    def homogenize(
        self,
        resolution: int = 64,
        *,
        young: float = 1.0,
        poisson: float = 0.3,
        kappa: float = 1.0,
        void: float = 1e-4,
        only: str | Iterable[str] | None = None,
        tets: str = "bcc",
        sharp: bool = False,
        fitted: bool = False,
        gradient: bool = False,
        residual: float = 1e-4,
        progress: Progress | None = None,
    ) -> dict[str, Any]:
        """Effective properties of the cell repeated without end, as ``druse cell homogenize`` computes them.

        Parameters
        ----------
        resolution : int
            Voxels along the period, an even number from 8 on.
        young, poisson, kappa : float
            Young's modulus, Poisson's ratio and conductivity of the solid; results have their units.
        void : float
            Moduli and conductivity of the void over those of the solid.
        only : str or iterable of str, optional
            Properties to compute: stiffness, conductivity, permeability; all when left out.
        tets : {"bcc", "kuhn"}
            Periodic packing of a cell of a tet: twelve or six in a cube.
        sharp : bool
            Round voxels to solid or void; results then satisfy all bounds.
        fitted : bool
            Use the series of struts and plates instead of round beams.
        gradient : bool
            Also compute derivatives by the level and by every coefficient.
        residual : float
            Residual at which iterations end, over that of the load.
        progress : callable, optional
            Called with stage, done and total.

        Returns
        -------
        dict
            ``stiffness`` [6, 6] (Voigt order 11 22 33 23 13 12, engineering shear), ``conductivity`` [3, 3],
            ``permeability`` of the void [3, 3] (squares of the period's edge), ``volume_fraction``, ``engineering``
            constants, Hashin-Shtrikman ``bounds`` (lower, upper) of bulk, shear and conductivity, ``over_bounds``
            (values over the upper bounds), and from 16 voxels on ``error`` (difference to a grid half as fine) and
            ``extrapolated``.
        """
        return homogenize(
            self, resolution, young, poisson, kappa, void, only, tets, sharp, fitted, gradient, residual, progress
        )

    def png(self) -> bytes:
        """Slices through the cell, and its error over the number of coefficients, as PNG."""
        return self._cell.png()

    def _repr_png_(self) -> bytes:
        return self.png()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Cell) and self._cell.to_json() == other._cell.to_json()

    def __hash__(self) -> int:
        return hash(self._cell.to_json())

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickle, (self._cell.to_json(), self._keys)

    def __repr__(self) -> str:
        return f"druse.Cell({self.name!r}, element={self.element!r}, solid={self.solid!r}, level={self.level:.6g})"


def _unpickle(text: str, keys: dict[str, Any] | None) -> Cell:
    return Cell._of(_druse.Cell.from_json(text), keys)


def _stem(name: str | os.PathLike[str]) -> str:
    return os.path.splitext(os.path.basename(os.fspath(name)))[0]


def fit(source: Any, element: str | None = None, progress: Progress | None = None, **keys: Any) -> Cell:
    """Fit a cell to geometry.

    Parameters
    ----------
    source : path, str, Mesh, or array
        A file (triangles, points with normals, voxels, struts, a .cell), the name of a surface, strut graph or plate
        set, a formula in x, y, z, a mesh in reference coordinates, or voxels over a period.
    element : str, optional
        The reference element: tri, quad, tet, hex, wedge, pyramid or ball.
    **keys
        Keys of ``[cell.NAME]`` in a recipe: band_limit, tolerance, group, lattice, place, volume_fraction, ...

    Returns
    -------
    Cell
        Its `report` states the accuracy.
    """
    keys = {**({} if element is None else {"element": element}), **keys}
    if isinstance(source, np.ndarray):
        known = {"element", "band_limit"}
        if unknown := set(keys) - known:
            raise ArgumentError(f"found {', '.join(sorted(unknown))} with an array; expected element and band_limit")
        return Cell.voxels(source, progress=progress, **keys)
    if isinstance(source, (str, os.PathLike)):
        return Cell._make(_stem(source), os.fspath(source), progress, keys)
    from tempfile import TemporaryDirectory

    from ._mesh import Mesh

    with TemporaryDirectory() as folder:
        path = os.path.join(folder, "source.ply")
        Mesh.of(source).save(path)
        return Cell._make("mesh", path, progress, keys)
