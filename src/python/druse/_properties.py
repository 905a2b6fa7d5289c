"""Effective properties of cells, and cells designed for target properties."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _druse
from ._arrays import Progress, count, finite, log, positive
from ._errors import ArgumentError
from ._toml import table

if TYPE_CHECKING:
    from ._cell import Cell

_PROPERTIES = ("stiffness", "conductivity", "permeability")
_DESIGN_KEYS = ("band_limit", "group", "lattice", "face_normal")


def homogenize(
    cell: Cell,
    resolution: int,
    young: float,
    poisson: float,
    kappa: float,
    void: float,
    only: str | Iterable[str] | None,
    tets: str,
    sharp: bool,
    fitted: bool,
    gradient: bool,
    residual: float,
    progress: Progress | None,
) -> dict[str, Any]:
    """See `Cell.homogenize`."""
    try:
        wanted = _PROPERTIES if only is None else (only,) if isinstance(only, str) else tuple(only)
    except TypeError as error:
        raise ArgumentError(f"only is {only!r}; expected names of properties") from error
    for name in wanted:
        if name not in _PROPERTIES:
            raise ArgumentError(f"only has {name!r}; expected {', '.join(_PROPERTIES)}")
    share = finite(void, "void")
    if not 0 <= share < 1:
        raise ArgumentError(f"void is {share}; expected a share from 0 on, below 1")
    solid = positive(young, "young"), finite(poisson, "poisson"), positive(kappa, "kappa")
    text, warnings = _druse.homogenize(
        cell._cell,
        None if fitted or cell._keys is None else table(cell._keys),
        str(tets),
        (count(resolution, "resolution"), bool(sharp), bool(gradient)),
        (*solid, share, finite(residual, "residual")),
        [name in wanted for name in _PROPERTIES],
        progress,
    )
    log(logging.WARNING, f"cell {cell.name}", warnings)
    found: dict[str, Any] = _arrays(json.loads(text))
    return found


def _arrays(value: Any) -> Any:
    """Return lists of numbers as arrays."""
    if isinstance(value, dict):
        return {key: _arrays(item) for key, item in value.items()}
    if isinstance(value, list):
        array = None if any(isinstance(v, dict) for v in value) else np.array(value)
        if array is not None and array.dtype.kind in "biuf":
            return array
        return [_arrays(item) for item in value]
    return value


def design(
    target: str | Mapping[str, Any],
    *,
    volume_fraction: float,
    element: str = "hex",
    solid: str = "below",
    start: str | os.PathLike[str] | None = None,
    seed: int | None = None,
    min_feature: float | None = None,
    match: Cell | Iterable[Cell] = (),
    resume: Cell | None = None,
    save: str | os.PathLike[str] | None = None,
    name: str = "designed",
    progress: Progress | None = None,
    **keys: Any,
) -> Cell:
    """Design a cell with target properties by an optimisation of its coefficients.

    Parameters
    ----------
    target : str or mapping
        The property to maximise (bulk, shear, young, conductivity or permeability), or a mapping with maximise,
        zener, poisson, stiffness [6, 6], weight, min_opening, min_permeability, max_permeability, starts, evaluations
        and voxels, as ``target`` of a recipe.
    volume_fraction : float
        Share of the element that is solid.
    element : {"hex", "tet"}
        The reference element.
    solid : {"below", "sheet"}
        A network, or a sheet around the surface.
    start : str or path, optional
        A surface by name or a .cell file to start from. Several starts are tried when left out.
    seed : int, optional
        Seed of random cells to start from.
    min_feature : float, optional
        Least width of walls and gaps, reference lengths; a cell that falls short is an error.
    match : Cell or iterable of Cell
        Cells whose trace on the faces the cell keeps, so that they meet.
    resume : Cell, optional
        A cell of an earlier search, which goes on.
    save : path, optional
        A .cell file for the result. An exception, such as that of Ctrl-C, ends the search without a result; the file
        then holds the best cell so far, with ``report["design"]["complete"]`` False.
    name : str
        Display name.
    progress : callable, optional
        Called with stage, done and total.
    **keys
        band_limit (4 when left out), group, lattice, face_normal.

    Returns
    -------
    Cell
        Its ``report["design"]`` has the objective, the history, and the properties of sharp voxels on two grids.
    """
    from ._cell import Cell

    for key in keys:
        if key not in _DESIGN_KEYS:
            raise ArgumentError(f"found the key {key!r}; expected one of {', '.join(_DESIGN_KEYS)}")
    matched = [match] if isinstance(match, Cell) else list(match)
    for other in [*matched, *([] if resume is None else [resume])]:
        if not isinstance(other, Cell):
            raise ArgumentError(f"found {type(other).__name__}; expected cells")
    wanted = {k: v for k, v in target.items() if v is not None} if isinstance(target, Mapping) else target
    section = {
        "target": wanted,
        "volume_fraction": volume_fraction,
        "element": element,
        "solid": solid,
        "start": None if start is None else os.fspath(start),
        "seed": seed,
        "min_feature": min_feature,
        **keys,
    }
    made = _druse.design(
        str(name),
        table(section),
        [other._cell for other in matched],
        None if resume is None else resume._cell,
        None if save is None else os.fspath(save),
        progress,
    )
    return Cell._of(made)
