"""Recipes: one document from sources to files."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping
from typing import Any

import numpy.typing as npt

from . import _druse
from ._arrays import Progress, count, log, points_of, shaped
from ._child import program
from ._errors import ArgumentError
from ._level_set import LevelSet
from ._toml import document, value

Overrides = Mapping[str, Any]
"""Values by dotted keys, such as ``{"band.voxel_size": 0.2}``."""


class Recipe:
    """A valid recipe.

    Parameters
    ----------
    source : path, or mapping
        A file, or the sections of a recipe; paths in a mapping start from the working directory.
    set : mapping, optional
        Values that replace others, by dotted keys; entries of arrays count from 0, as in ``op.2.dilate``.

    Raises
    ------
    RecipeError
        With line, column and advice.
    """

    def __init__(self, source: str | os.PathLike[str] | Mapping[str, Any], set: Overrides | None = None) -> None:
        overrides = _overrides(set)
        if isinstance(source, Mapping):
            self._adopt(None, document(source), overrides)
        elif isinstance(source, (str, os.PathLike)):
            self._adopt(os.fspath(source), None, overrides)
        else:
            raise ArgumentError(f"found {type(source).__name__}; expected a path or a mapping")

    def _adopt(self, path: str | None, text: str | None, overrides: list[str]) -> None:
        self._source = (path, text, overrides)
        self._recipe = _druse.Recipe(path, text, overrides)

    @classmethod
    def parse(cls, text: str, set: Overrides | None = None) -> Recipe:
        """A recipe from its text (TOML)."""
        made = cls.__new__(cls)
        made._adopt(None, text, _overrides(set))
        return made

    @property
    def text(self) -> str:
        """The text, with its overrides as comments."""
        return self._recipe.text()

    def to_dict(self) -> dict[str, Any]:
        """The sections of the text; overrides are not in them."""
        sections: dict[str, Any] = json.loads(self._recipe.json())
        return sections

    def estimate(self) -> dict[str, Any]:
        """What a run needs and writes: voxels, memory, disk and time."""
        estimate: dict[str, Any] = json.loads(self._recipe.estimate(program()))
        return estimate

    def evaluate(self, points: npt.ArrayLike, *, exact: bool = False) -> dict[str, Any]:
        """The tiled field of the recipe's scaffold at points [..., 3], without voxels, as ``druse eval``.

        Parameters
        ----------
        points : array_like, shape [..., 3]
            World coordinates.
        exact : bool
            Evaluate the cells' series instead of their tables.

        Returns
        -------
        dict
            ``phi`` [...] and ``gradient`` [..., 3] of the field, ``distance`` [...] to the solid (within the half width
            of the band), ``element`` [...] (the file's number, -1 outside), ``reference`` [..., 3] coordinates, and
            ``weights``, a mapping of cells to arrays [...]. All but ``distance`` are NaN outside the scaffold.
        """
        own, shape = points_of(points)
        cells, found = self._recipe.evaluate(program(), own, bool(exact))
        phi, gradient, distance, element, reference, weights = found
        by_cell = weights.reshape(-1, len(cells))
        return {
            "phi": shaped(phi, shape),
            "gradient": gradient.reshape((*shape, 3)),
            "distance": shaped(distance, shape),
            "element": shaped(element, shape),
            "reference": reference.reshape((*shape, 3)),
            "weights": {name: shaped(by_cell[:, n].copy(), shape) for n, name in enumerate(cells)},
        }

    def run(
        self,
        *,
        out: str | os.PathLike[str] | None = None,
        memory: int | None = None,
        strict: bool = False,
        brief: bool = False,
        progress: Progress | None = None,
    ) -> LevelSet:
        """Run the recipe; see `druse.run`."""
        limit = None if memory is None else _bytes(memory)
        place = None if out is None else os.fspath(out)
        text, solid = self._recipe.run(program(), place, limit, bool(strict), bool(brief), progress)
        report: dict[str, Any] = json.loads(text)
        scaffold = report.get("scaffold") or {}
        log(logging.INFO, "scaffold", scaffold.get("notes", []))
        for warning in report["warnings"]:
            log(logging.WARNING, warning["code"], [warning["message"]])
        for requirement in report.get("requirements") or []:
            if not requirement["met"]:
                log(logging.WARNING, f"require {requirement['name']}", [f"not met: found {requirement['found']}"])
        if solid is None:
            part = _written(report)
        else:
            part = LevelSet._of(solid)
        part.report = report
        return part

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickle, self._source

    def __repr__(self) -> str:
        return f"druse.Recipe({self._source[0] or 'mapping'!r})"


def _overrides(set: Overrides | None) -> list[str]:
    if set is not None and not isinstance(set, Mapping):
        raise ArgumentError(f"set is {set!r}; expected a mapping such as {{'band.voxel_size': 0.2}}")
    return [f"{key}={value(item)}" for key, item in (set or {}).items()]


def _unpickle(path: str | None, text: str | None, overrides: list[str]) -> Recipe:
    made = Recipe.__new__(Recipe)
    made._adopt(path, text, overrides)
    return made


def _bytes(memory: object) -> int:
    if isinstance(memory, int) and 0 < memory < 1 << 60:
        return memory
    raise ArgumentError(f"memory is {memory!r}; expected a number of bytes")


def _written(report: dict[str, Any]) -> LevelSet:
    """Read back the level set of a run that went through bricks."""
    paths = [output["path"] for output in report["outputs"] if str(output["path"]).endswith(".vdb")]
    if not paths:
        raise ArgumentError("the run went through bricks and wrote no .vdb; expected an output of kind vdb")
    return LevelSet.read(paths[0])


def run(
    recipe: Recipe | str | os.PathLike[str] | Mapping[str, Any],
    set: Overrides | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    memory: int | None = None,
    strict: bool = False,
    brief: bool = False,
    progress: Progress | None = None,
) -> LevelSet:
    """Run a recipe: write its outputs and return its level set.

    Parameters
    ----------
    recipe : path, mapping or Recipe
        The recipe.
    set : mapping, optional
        Values that replace others, by dotted keys: ``{"band.voxel_size": 0.2}``.
    out : path, optional
        Directory of the outputs; the recipe's own when left out.
    memory : int, optional
        Bytes that the run may use; a part that needs more goes through bricks on the disk.
    strict : bool
        Whether a warning is an error.
    brief : bool
        Whether to skip slow measures that no output needs.
    progress : callable, optional
        Called with stage, done and total, a few times a second.

    Returns
    -------
    LevelSet
        The finished part; its `report` is that of the run. Warnings go to the logger ``druse``, and so do requirements of
        ``[require]`` that are not met; ``part.report["requirements"]`` has all of them.
    """
    if isinstance(recipe, Recipe):
        if set:
            raise ArgumentError("found set with a Recipe; expected it where the recipe is made")
        own = recipe
    else:
        own = Recipe(recipe, set)
    return own.run(out=out, memory=memory, strict=strict, brief=brief, progress=progress)


def set_threads(threads: int) -> None:
    """Set the number of threads of all later work; 0 means one for each core."""
    _druse.set_threads(min(count(threads, "threads"), 1024))


def schema() -> dict[str, Any]:
    """The JSON schema of recipes."""
    found: dict[str, Any] = json.loads(_druse.schema())
    return found
