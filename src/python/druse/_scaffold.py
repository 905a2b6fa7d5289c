"""Scaffolds: the meshes of solid elements that cells fill."""

from __future__ import annotations

import importlib
import logging
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _druse
from ._arrays import Floats, count, log, numeric, points_of, positive, read_only, shaped, vector
from ._errors import ArgumentError

if TYPE_CHECKING:
    from ._mesh import Mesh

# VTK types by their names in meshio; nodes are in VTK order.
_TYPES = {
    "tetra": 10,
    "hexahedron": 12,
    "wedge": 13,
    "pyramid": 14,
    "tetra10": 24,
    "hexahedron20": 25,
    "wedge15": 26,
    "pyramid13": 27,
    "hexahedron27": 29,
}
# VTK's triquadratic pyramid, and its axis-aligned hexahedron with the places of that one's nodes.
_PYRAMID14 = 37
_VOXEL = 11
_VOXEL_ORDER = [0, 1, 3, 2, 4, 5, 7, 6]
_BOXES = {"hex": 12, "tet": 10, "wedge": 13, "pyramid": 14}


class Scaffold:
    """Nodes and solid elements.

    Parameters
    ----------
    nodes : array_like, float, shape [n, 3]
        Positions, in world units.
    elements : mapping of str to array_like, int, shape [m, k]
        Node numbers in VTK order, by the type's name in meshio: tetra, hexahedron, wedge, pyramid, tetra10,
        hexahedron20, wedge15, pyramid13, hexahedron27.
    fields : mapping of str to array_like, optional
        Values at nodes [n] or [n, c], or at elements [m] or [m, c].
    """

    def __init__(
        self,
        nodes: npt.ArrayLike,
        elements: Mapping[str, npt.ArrayLike],
        fields: Mapping[str, npt.ArrayLike] | None = None,
    ) -> None:
        connectivity: list[npt.NDArray[np.int64]] = []
        counts: list[npt.NDArray[np.int64]] = []
        types: list[npt.NDArray[np.uint8]] = []
        for name, rows in elements.items():
            if name not in _TYPES:
                raise ArgumentError(f"found elements of type {name!r}; expected {', '.join(_TYPES)}")
            own = numeric(rows, f"elements[{name!r}]", np.int64)
            if own.ndim != 2:
                raise ArgumentError(f"elements[{name!r}] has the shape {list(own.shape)}; expected [m, nodes]")
            connectivity.append(own.ravel())
            counts.append(np.full(len(own), own.shape[1], dtype=np.int64))
            types.append(np.full(len(own), _TYPES[name], dtype=np.uint8))
        if not connectivity:
            raise ArgumentError("no elements; expected at least one tetrahedron, hexahedron, wedge or pyramid")
        offsets = np.concatenate([[0], np.cumsum(np.concatenate(counts))]).astype(np.int64)
        self._build(nodes, offsets, np.concatenate(connectivity), np.concatenate(types), fields or {})

    def _build(
        self, nodes: Any, offsets: Any, connectivity: Any, types: Any, fields: Mapping[str, npt.ArrayLike]
    ) -> None:
        own = numeric(nodes, "nodes", np.float64)
        if own.ndim != 2 or own.shape[1] != 3:
            raise ArgumentError(f"nodes has the shape {list(own.shape)}; expected [n, 3]")
        scaffold = _druse.Scaffold(
            own,
            numeric(offsets, "offsets", np.int64),
            numeric(connectivity, "connectivity", np.int64),
            numeric(types, "types", np.uint8),
        )
        self._adopt(scaffold)
        for name, values in fields.items():
            array = numeric(values, f"field {name!r}", np.float64)
            if array.ndim == 0 or len(array) not in (len(own), len(self)):
                raise ArgumentError(
                    f"field {name!r} has the shape {list(array.shape)}; expected {len(own)} nodes or {len(self)} elements"
                )
            self.fields[str(name)] = array

    def _adopt(self, scaffold: _druse.Scaffold) -> None:
        self._scaffold = scaffold
        self._nodes: Floats | None = None
        self.fields: dict[str, Floats] = {}
        """Values at nodes or elements, by name."""

    @classmethod
    def _of(cls, scaffold: _druse.Scaffold) -> Scaffold:
        made = cls.__new__(cls)
        made._adopt(scaffold)
        return made

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Scaffold:
        """Read a mesh of solids: .msh, .vtu, .vtk, .inp, .bdf, .unv, .mesh. Its data become `fields`."""
        read, fields, notes, warnings = _druse.Scaffold.read(os.fspath(path))
        log(logging.INFO, os.fspath(path), notes)
        log(logging.WARNING, os.fspath(path), warnings)
        made = cls._of(read)
        for name, _, components, values in fields:
            made.fields[name] = values if components == 1 else values.reshape(-1, components)
        return made

    @classmethod
    def box(cls, size: npt.ArrayLike, counts: npt.ArrayLike, kind: str = "hex") -> Scaffold:
        """A box from the origin to `size` in `counts` cells of hexes, tets, wedges or pyramids."""
        if kind not in _BOXES:
            raise ArgumentError(f"kind is {kind!r}; expected {', '.join(_BOXES)}")
        numbers = numeric(counts, "counts", np.int64)
        if numbers.shape != (3,):
            raise ArgumentError(f"counts has the shape {list(numbers.shape)}; expected [3]")
        cells = [count(n, "counts") for n in numbers]
        if int(np.prod([float(n) for n in cells])) > 1 << 24:
            raise ArgumentError(f"counts is {cells}; expected at most 2^24 cells")
        return cls._of(_druse.Scaffold.of_box(vector(size, "size"), cells, _BOXES[kind]))

    @classmethod
    def of(cls, mesh: Any) -> Scaffold:
        """Convert a mesh of meshio or a grid of pyvista; the arrays are copied, data become `fields`.

        Elements that are not solid (lines, triangles, quads) are left out, with their data.
        """
        if isinstance(mesh, Scaffold):
            return mesh
        if not hasattr(mesh, "celltypes") and hasattr(type(mesh), "cast_to_unstructured_grid"):  # other grids of pyvista
            mesh = mesh.cast_to_unstructured_grid()
        if hasattr(mesh, "celltypes") and hasattr(mesh, "cell_connectivity"):  # pyvista
            made = cls.__new__(cls)
            is_solid, offsets, connectivity, types = _solids(mesh)
            found = _numeric_fields(mesh.cell_data).items()
            cells = {name: values[is_solid] for name, values in found if len(values) == len(is_solid)}
            made._build(mesh.points, offsets, connectivity, types, {**cells, **_numeric_fields(mesh.point_data)})
            return made
        if hasattr(mesh, "cells") and hasattr(mesh, "points"):  # meshio
            solids = [(n, b) for n, b in enumerate(mesh.cells) if b.type in _TYPES]
            elements: dict[str, Any] = {}
            for _, block in solids:
                own = [elements[block.type]] if block.type in elements else []
                elements[block.type] = np.concatenate([*own, block.data])
            data = _numeric_fields(mesh.point_data)
            order = [n for name in elements for n, b in solids if b.type == name]
            for name, blocks in mesh.cell_data.items():
                values = np.concatenate([np.asarray(blocks[n]) for n in order]) if order else np.zeros(0)
                if values.dtype.kind in "biuf":
                    data.setdefault(name, values)
            return cls(mesh.points, elements, data)
        raise ArgumentError(
            f"found {type(mesh).__name__}; expected a Scaffold, a mesh of meshio or a pyvista.UnstructuredGrid"
        )

    @property
    def nodes(self) -> Floats:
        """Positions [n, 3]; one array that is closed to writing, made on first use."""
        if self._nodes is None:
            self._nodes = read_only(self._scaffold.nodes())
        return self._nodes

    @property
    def elements(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.uint8]]:
        """Offsets [m + 1], node numbers and VTK types [m] of the elements; copies."""
        return self._scaffold.elements()

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner [2, 3]."""
        return np.array(self._scaffold.bounds())

    @property
    def volume(self) -> float:
        """Volume of all elements."""
        return self._scaffold.volume()

    def locate(self, points: npt.ArrayLike) -> tuple[Any, Any]:
        """Elements [...] (-1 outside) and reference coordinates [..., 3] (NaN outside) of points [..., 3]."""
        own, shape = points_of(points)
        elements, places = self._scaffold.locate(own)
        return shaped(elements, shape), places.reshape((*shape, 3))

    def surface(self, error: float | None = None) -> Mesh:
        """The outer faces as triangles, within `error` of curved ones (a hundredth of an element when left out)."""
        from ._mesh import Mesh

        within = self._scaffold.stretch()[0] / 100 if error is None else positive(error, "error")
        return Mesh._of(self._scaffold.surface(within))

    def __reduce__(self) -> tuple[Any, ...]:
        offsets, connectivity, types = self.elements
        return _unpickle, (np.asarray(self.nodes), offsets, connectivity, types, self.fields)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a .vtu file with the fields; a field of several numbers becomes NAME_0, NAME_1 and so on."""
        nodes: list[tuple[str, Floats]] = []
        elements: list[tuple[str, Floats]] = []
        for name, values in self.fields.items():
            array = numeric(values, f"field {name!r}", np.float64)
            if array.ndim == 0 or len(array) not in (len(self.nodes), len(self)):
                raise ArgumentError(
                    f"field {name!r} has the shape {list(array.shape)}; expected {len(self.nodes)} nodes or "
                    f"{len(self)} elements"
                )
            place = nodes if len(array) == len(self.nodes) else elements
            if array.ndim == 1:
                place.append((name, array))
                continue
            columns = np.ascontiguousarray(array.reshape(len(array), -1).T)
            place += [(f"{name}_{n}", column) for n, column in enumerate(columns)]
        self._scaffold.save(os.fspath(path), nodes, elements)

    def to_meshio(self) -> Any:
        """The scaffold as meshio.Mesh with its fields; needs meshio."""
        meshio: Any = importlib.import_module("meshio")

        offsets, connectivity, types = self.elements
        blocks: list[tuple[str, Any]] = []
        rows: list[Any] = []
        for name, kind in _TYPES.items():
            own = np.flatnonzero(types == kind)
            if len(own):
                width = int(offsets[own[0] + 1] - offsets[own[0]])
                blocks.append((name, connectivity[offsets[own][:, None] + np.arange(width)]))
                rows.append(own)
        if sum(len(own) for own in rows) < len(types):
            raise ArgumentError("the scaffold has pyramids of 14 nodes; meshio has no name for them")
        at_nodes = {name: values for name, values in self.fields.items() if len(values) == len(self.nodes)}
        at_elements = {
            name: [values[own] for own in rows] for name, values in self.fields.items() if name not in at_nodes
        }
        return meshio.Mesh(np.array(self.nodes), blocks, point_data=at_nodes, cell_data=at_elements)

    def _repr_png_(self) -> bytes | None:
        return self.surface()._repr_png_()

    def to_pyvista(self) -> Any:
        """The scaffold as pyvista.UnstructuredGrid with its fields; needs pyvista."""
        pyvista: Any = importlib.import_module("pyvista")

        offsets, connectivity, types = self.elements
        counts = np.diff(offsets)
        cells = np.insert(connectivity, offsets[:-1], counts)
        grid = pyvista.UnstructuredGrid(cells, types, np.array(self.nodes))
        for name, values in self.fields.items():
            (grid.point_data if len(values) == len(self.nodes) else grid.cell_data)[name] = values
        return grid

    def __len__(self) -> int:
        return len(self._scaffold)

    def __repr__(self) -> str:
        return f"druse.Scaffold({len(self.nodes)} nodes, {len(self)} elements)"


def _offsets(mesh: Any) -> Any:
    """Return the offsets of the cells of a grid; the older name of the attribute warns where the newer one exists."""
    return mesh.cell_offsets if hasattr(mesh, "cell_offsets") else mesh.offset


def _solids(mesh: Any) -> tuple[npt.NDArray[np.bool_], Any, Any, Any]:
    """Return which cells of a grid of pyvista are solid, and their offsets, node numbers and types."""
    types = numeric(mesh.celltypes, "celltypes", np.int64).ravel()
    offsets = numeric(_offsets(mesh), "offset", np.int64).ravel()
    nodes = numeric(mesh.cell_connectivity, "cell_connectivity", np.int64).ravel()
    is_solid = np.isin(types, [*_TYPES.values(), _PYRAMID14, _VOXEL])
    counts = np.diff(offsets)
    is_sound = len(counts) == len(types) and (counts >= 0).all() and int(counts.sum()) == len(nodes)
    if not is_sound or not is_solid.any() or (counts[types == _VOXEL] != 8).any():
        return np.ones(len(types), dtype=bool), offsets, nodes, types
    nodes = nodes[np.repeat(is_solid, counts)]
    types, counts = types[is_solid], counts[is_solid]
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    # A voxel is a hexahedron with its nodes in another order.
    rows = offsets[:-1][types == _VOXEL][:, None] + np.arange(8)
    nodes[rows] = nodes[rows][:, _VOXEL_ORDER]
    return is_solid, offsets, nodes, np.where(types == _VOXEL, _TYPES["hexahedron"], types)


def _numeric_fields(data: Any) -> dict[str, Any]:
    arrays = {str(name): np.asarray(values) for name, values in data.items()}
    return {name: values for name, values in arrays.items() if values.dtype.kind in "biuf"}


def _unpickle(nodes: Any, offsets: Any, connectivity: Any, types: Any, fields: dict[str, Any]) -> Scaffold:
    made = Scaffold.__new__(Scaffold)
    made._build(nodes, offsets, connectivity, types, fields)
    return made
