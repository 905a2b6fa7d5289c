"""Tilings whose thickness holds in space: round beams, plates and sheets, made through a recipe."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ._arrays import Floats, Progress
from ._cell import Cell
from ._errors import ArgumentError
from ._level_set import LevelSet
from ._recipe import Recipe
from ._scaffold import Scaffold

# Limits of the half width of a recipe's band, voxels.
_MIN_HALF_WIDTH, _MAX_HALF_WIDTH = 1.5, 64.0
# Keys of a section that only a fitted cell has, with their neutral values.
_FITTED_KEYS = {"invert": False, "solid": "below", "place": "reference"}
_PLANAR = ("tri", "quad")
_LEVEL_KEYS = ("level", "volume_fraction", "thickness")


def is_round(cells: Sequence[Cell], gradings: Mapping[str, Any]) -> bool:
    """Whether cells become round beams and plates: by ``section``, else where a thickness is given."""
    return all(_is_round(cell, gradings) for cell in cells)


def _is_round(cell: Cell, gradings: Mapping[str, Any]) -> bool:
    keys = cell._keys
    if keys is None:
        return False
    if "section" in keys:
        return bool(keys["section"] == "round")
    is_plain = all(keys.get(key, neutral) == neutral for key, neutral in _FITTED_KEYS.items())
    return "thickness" in gradings and is_plain and cell.element not in _PLANAR


def is_metric_sheet(cells: Sequence[Cell], gradings: Mapping[str, Any]) -> bool:
    """Whether cells are sheets with a thickness in world units."""
    return "thickness" in gradings and all(cell.solid == "sheet" for cell in cells)


class MetricTiling:
    """A tiling as the recipe that describes it; its scaffold and cells pass through files of a temporary folder."""

    def __init__(
        self,
        scaffold: Scaffold,
        cells: Sequence[Cell],
        weights: Floats | None,
        graded: tuple[str, Floats | float] | None,
        words: tuple[str, str, str],
        turning: dict[str, Any],
    ) -> None:
        if weights is None and len(cells) > 1:
            raise ArgumentError(
                f"found {len(cells)} cells of struts or sheets without weights; expected one cell, or weights"
            )
        self._scaffold = scaffold
        self._cells = cells
        self._graded = graded
        self._weights = None if weights is None else weights.reshape(-1, len(cells))
        self._words = words
        self._turning = {key: value for key, value in turning.items() if value is not None}
        # Faults of cells that do not fit the scaffold appear here.
        edge = scaffold._scaffold.stretch()[1]
        self.distance(np.zeros((0, 3)), edge, edge)

    def _recipe(self, folder: str, voxel_size: float, half_width: float) -> Recipe:
        """The recipe, with its files in a folder; `half_width` in voxels."""
        fields: list[tuple[str, Floats]] = []
        interpolation, distance, boundary = self._words
        tiling: dict[str, Any] = {"interpolation": interpolation}
        if self._turning != {"mismatch": "error"}:
            tiling["orient"] = self._turning
        names = [f"cell_{n}" for n in range(len(self._cells))]
        if self._weights is None:
            tiling["cell"] = names[0]
        else:
            columns = np.ascontiguousarray(self._weights.T)
            fields += [(f"weight_{name}", column) for name, column in zip(names, columns)]
            tiling["transition"] = [{"cell": name, "weight": {"field": f"weight_{name}"}} for name in names]
        if self._graded is not None:
            key, values = self._graded
            if isinstance(values, float):
                tiling[key] = values
            else:
                fields.append((key, values))
                tiling[key] = {"field": key}
        sections: dict[str, Any] = {}
        for name, cell in zip(names, self._cells):
            if cell._keys is not None and cell.solid != "sheet":
                # A grading replaces the cell's own thickness or volume fraction.
                own = cell._keys.items()
                sections[name] = {k: v for k, v in own if self._graded is None or k not in _LEVEL_KEYS}
            else:
                path = os.path.join(folder, f"{name}.cell")
                cell.save(path)
                sections[name] = {"file": path, "solid": "sheet"}
        path = os.path.join(folder, "scaffold.vtu")
        self._scaffold._scaffold.save(path, fields, [])
        return Recipe(
            {
                "druse": 1,
                "cell": sections,
                "scaffold": {"file": path, "boundary": boundary},
                "tiling": tiling,
                "band": {"voxel_size": voxel_size, "half_width": half_width, "distance": distance},
            }
        )

    def distance(self, points: Floats, voxel_size: float, half_width: float) -> Floats:
        """Signed distances [n] at points [n, 3], clamped to `half_width`, world units."""
        size = float(np.clip(voxel_size, half_width / _MAX_HALF_WIDTH, half_width / _MIN_HALF_WIDTH))
        # A quotient at a limit may round beyond it.
        width = float(np.clip(half_width / size, _MIN_HALF_WIDTH, _MAX_HALF_WIDTH))
        with TemporaryDirectory(prefix="druse-") as folder:
            found: Floats = self._recipe(folder, size, width).evaluate(points)["distance"]
        return found

    def level_set(self, voxel_size: float, half_width: float, progress: Progress | None) -> LevelSet:
        """The level set; `half_width` in voxels."""
        with TemporaryDirectory(prefix="druse-") as folder:
            return self._recipe(folder, voxel_size, half_width).run(brief=True, progress=progress)
