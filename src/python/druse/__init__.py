"""Lattices and microstructures on unstructured meshes, as OpenVDB level sets.

>>> import druse
>>> cell = druse.Cell.surface("schwarz_p", element="hex").with_volume_fraction(0.3)
>>> scaffold = druse.Scaffold.box([10, 10, 10], [2, 2, 2])
>>> part = druse.Tiling(scaffold, cell).level_set(voxel_size=0.25)
>>> vertices, faces = part.mesh()

Distances are negative inside. World units are the user's; cells have reference units, in which the edges of an
element are 1 (of a tet sqrt 2). Work runs without the interpreter's lock, in parallel, and Ctrl-C ends it.
"""

from ._arrays import Progress
from ._cell import Cell, fit
from ._druse import __version__
from ._errors import ArgumentError, Error, FileError, RecipeError
from ._level_set import LevelSet
from ._mesh import Mesh, crystal
from ._properties import design
from ._recipe import Recipe, run, schema, set_threads
from ._scaffold import Scaffold
from ._tiling import Tiling

__all__ = [
    "ArgumentError",
    "Cell",
    "Error",
    "FileError",
    "LevelSet",
    "Mesh",
    "Progress",
    "Recipe",
    "RecipeError",
    "Scaffold",
    "Tiling",
    "__version__",
    "crystal",
    "design",
    "fit",
    "run",
    "schema",
    "set_threads",
]
