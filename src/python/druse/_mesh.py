"""Triangle meshes."""

from __future__ import annotations

import importlib
import logging
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _druse
from ._arrays import Floats, Progress, half_width_of, log, numeric, points_of, positive, read_only, shaped
from ._errors import ArgumentError

if TYPE_CHECKING:
    from ._level_set import LevelSet

# Voxels along the longest edge of a picture's level set.
_PICTURE_VOXELS = 200


class Mesh:
    """Triangles over shared vertices, counter-clockwise seen from outside.

    Unpacks into its arrays: ``vertices, faces = mesh``.

    Parameters
    ----------
    vertices : array_like, float, shape [n, 3]
        Positions, in world units.
    faces : array_like, int, shape [m, 3]
        Vertex numbers of the triangles.
    """

    def __init__(self, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> None:
        own = numeric(vertices, "vertices", np.float64)
        triangles = numeric(faces, "faces", np.uint32)
        for array, name in ((own, "vertices"), (triangles, "faces")):
            if array.ndim != 2 or array.shape[1] != 3:
                raise ArgumentError(f"{name} has the shape {list(array.shape)}; expected [n, 3]")
        self._adopt(_druse.Mesh(own, triangles))

    def _adopt(self, mesh: _druse.Mesh) -> None:
        self._mesh = mesh
        self._vertices: Floats | None = None
        self._faces: npt.NDArray[np.uint32] | None = None

    @classmethod
    def _of(cls, mesh: _druse.Mesh) -> Mesh:
        made = cls.__new__(cls)
        made._adopt(mesh)
        return made

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Mesh:
        """Read a mesh: .stl, .obj, .ply, .off, .3mf, .vtp and surfaces of .vtu, .vtk, .msh, .inp."""
        mesh, warnings = _druse.Mesh.read(os.fspath(path))
        log(logging.WARNING, os.fspath(path), warnings)
        return cls._of(mesh)

    @classmethod
    def of(cls, mesh: Any) -> Mesh:
        """Convert a mesh of trimesh, pyvista or meshio, or a pair (vertices, faces).

        The arrays are copied; polygons are cut into triangles.
        """
        if isinstance(mesh, Mesh):
            return mesh
        if hasattr(mesh, "vertices") and hasattr(mesh, "faces") and not hasattr(mesh, "n_points"):
            return cls(mesh.vertices, mesh.faces)
        if hasattr(type(mesh), "extract_surface"):  # pyvista
            surface = mesh if hasattr(type(mesh), "regular_faces") else mesh.extract_surface()
            surface = surface.triangulate()
            return cls(surface.points, np.asarray(surface.faces).reshape(-1, 4)[:, 1:])
        if hasattr(mesh, "points") and hasattr(mesh, "cells_dict"):  # meshio
            faces = [np.asarray(rows) for name, rows in mesh.cells_dict.items() if name in ("triangle", "quad")]
            if not faces:
                raise ArgumentError(f"the mesh has {', '.join(mesh.cells_dict)}; expected triangles or quads")
            cut = [rows if rows.shape[1] == 3 else rows[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3) for rows in faces]
            return cls(_spatial(mesh.points), np.concatenate(cut))
        if isinstance(mesh, tuple) and len(mesh) == 2:
            return cls(*mesh)
        raise ArgumentError(
            f"found {type(mesh).__name__}; expected a Mesh, (vertices, faces), or a mesh of trimesh, pyvista or meshio"
        )

    def save(self, path: str | os.PathLike[str], unit: str = "mm") -> None:
        """Write the mesh: .stl, .obj, .ply, .3mf. `unit` is that of the coordinates."""
        self._mesh.save(os.fspath(path), unit)

    @property
    def vertices(self) -> Floats:
        """Positions [n, 3]; one array that is closed to writing, made on first use."""
        if self._vertices is None:
            self._vertices = read_only(self._mesh.vertices())
        return self._vertices

    @property
    def faces(self) -> npt.NDArray[np.uint32]:
        """Vertex numbers [m, 3]; one array that is closed to writing, made on first use."""
        if self._faces is None:
            self._faces = read_only(self._mesh.faces())
        return self._faces

    @property
    def volume(self) -> float:
        """Enclosed volume, for closed meshes."""
        return self._mesh.volume()

    @property
    def area(self) -> float:
        """Sum of the areas of the triangles."""
        return self._mesh.area()

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner [2, 3]."""
        return np.array(self._mesh.bounds())

    def distance(self, points: npt.ArrayLike) -> Any:
        """Signed distances [...] at points [..., 3], negative inside."""
        own, shape = points_of(points)
        return shaped(self._mesh.distance(own), shape)

    def level_set(self, voxel_size: float, half_width: float = 3.0, progress: Progress | None = None) -> LevelSet:
        """The level set of the solid that the triangles bound.

        Holes and wrong orientations are repaired; the logger `druse` reports them.

        Parameters
        ----------
        voxel_size : float
            World units.
        half_width : float
            Half width of the band, voxels.
        progress : callable, optional
            Called with stage, done and total.
        """
        from ._level_set import LevelSet

        made, notes = self._mesh.level_set(
            positive(voxel_size, "voxel_size"), half_width_of(half_width), progress
        )
        log(logging.INFO, "mesh", notes)
        return LevelSet._of(made)

    def to_trimesh(self) -> Any:
        """The mesh as trimesh.Trimesh; needs trimesh."""
        trimesh: Any = importlib.import_module("trimesh")

        return trimesh.Trimesh(np.array(self.vertices), self.faces.astype(np.int64), process=False)

    def to_meshio(self) -> Any:
        """The mesh as meshio.Mesh; needs meshio."""
        meshio: Any = importlib.import_module("meshio")

        return meshio.Mesh(np.array(self.vertices), [("triangle", self.faces.astype(np.int64))])

    def png(self, width: int = 800, height: int = 640) -> bytes:
        """A shaded picture as PNG, of a level set of the mesh."""
        size = float((self.bounds[1] - self.bounds[0]).max())
        return self.level_set(positive(size, "size") / _PICTURE_VOXELS).png(width, height)

    def _repr_png_(self) -> bytes | None:
        return self.png() if self._mesh.counts()[1] else None

    def to_pyvista(self) -> Any:
        """The mesh as pyvista.PolyData; needs pyvista."""
        pyvista: Any = importlib.import_module("pyvista")

        return pyvista.PolyData.from_regular_faces(self.vertices, self.faces.astype(np.int64))

    def __iter__(self) -> Iterator[npt.NDArray[Any]]:
        return iter((self.vertices, self.faces))

    def __reduce__(self) -> tuple[Any, ...]:
        return Mesh, (np.asarray(self.vertices), np.asarray(self.faces))

    def __repr__(self) -> str:
        vertices, faces = self._mesh.counts()
        return f"druse.Mesh({vertices} vertices, {faces} faces)"


def _spatial(points: Any) -> Any:
    """Return points of a plane with z = 0."""
    array = np.asarray(points)
    return np.pad(array, ((0, 0), (0, 1))) if array.ndim == 2 and array.shape[1] == 2 else array


def crystal(script: str) -> Mesh:
    """The triangles of a polygon modelling script, as ``form cubic [1,1,0]=1``."""
    return Mesh._of(_druse.crystal(script))
