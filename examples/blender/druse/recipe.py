# SPDX-License-Identifier: MIT OR Apache-2.0
"""From a Blender object and the panel's settings to a folder with a mesh per frame and a recipe."""

import os
import struct
import tempfile

import bpy

# Name of a cell, its label, and its tooltip; sheets are surfaces, the others are struts.
SURFACES = ("gyroid", "schwarz_p", "diamond", "iwp")
CELLS = (
    ("gyroid", "Gyroid", "A sheet"),
    ("schwarz_p", "Schwarz P", "A sheet"),
    ("diamond", "Diamond", "A sheet"),
    ("iwp", "I-WP", "A sheet"),
    ("bcc", "Body-centred", "Round struts"),
    ("octet", "Octet", "Round struts"),
)


class Job:
    """A folder with a recipe, and the files that its run writes; `frames` is None for a still."""

    def __init__(self, folder, frames):
        self.folder = folder
        self.frames = frames
        self.recipe = os.path.join(folder, "part.toml")

    def path(self, suffix, frame=None):
        """The output with a suffix such as .vdb, at a frame of a sequence."""
        number = "" if self.frames is None else f".{(self.frames[0] if frame is None else frame):04d}"
        return os.path.join(self.folder, f"part{number}{suffix}")


def write_stl(path, obj, depsgraph):
    """Writes the object with its modifiers, in world space, as binary STL. An open mesh is an error."""
    evaluated = obj.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    if not mesh.loop_triangles:
        raise ValueError(f"{obj.name} has no faces; expected a closed mesh")
    matrix = evaluated.matrix_world
    points = [matrix @ v.co for v in mesh.vertices]
    flips = matrix.determinant() < 0.0
    with open(path, "wb") as file:
        file.write(b"Druse".ljust(80, b" ") + struct.pack("<I", len(mesh.loop_triangles)))
        for triangle in mesh.loop_triangles:
            corners = [points[v] for v in triangle.vertices]
            if flips:
                corners.reverse()
            values = [0.0, 0.0, 0.0] + [c for corner in corners for c in corner]
            file.write(struct.pack("<12fH", *values, 0))
    evaluated.to_mesh_clear()


def text(settings, fps, frames):
    """The recipe of the settings; the mesh fills with hexes, which its surface cuts."""
    token = "" if frames is None else ".$F4"
    mesh = f"mesh{token}.stl"
    is_sheet = settings.cell in SURFACES
    source = f'surface = "{settings.cell}"\nsolid = "sheet"' if is_sheet else f'graph = "{settings.cell}"'
    lines = [
        "druse = 1",
        'unit = "m"',
        f"fps = {fps:g}",
        "[cell.cell]",
        'element = "hex"',
        source,
        "[scaffold]",
        f'fill = {{ mesh = "{mesh}", cell_size = {settings.cell_size:.9g} }}',
        'boundary = "extend"',
        "[tiling]",
        'cell = "cell"',
        f"thickness = {settings.thickness:.9g}",
        "[band]",
        f"voxel_size = {settings.voxel_size:.9g}",
        "[[op]]",
        f'intersect = {{ mesh = "{mesh}" }}',
    ]
    if settings.skin > 0.0:
        lines += ["[[op]]", f'union = {{ skin = {{ mesh = "{mesh}", thickness = {settings.skin:.9g} }} }}']
    lines += ["[[output]]", f'vdb = "part{token}.vdb"', "fog = true"]
    if settings.as_mesh:
        lines += ["[[output]]", f'mesh = "part{token}.stl"']
    return "\n".join(lines) + "\n"


def write(context, obj, settings):
    """Writes the meshes and the recipe of an object; returns the job."""
    folder = bpy.path.abspath(settings.folder) if settings.folder else tempfile.mkdtemp(prefix="druse-")
    os.makedirs(folder, exist_ok=True)
    scene = context.scene
    frames = list(range(scene.frame_start, scene.frame_end + 1)) if settings.sequence else None
    job = Job(folder, frames)
    if frames is None:
        write_stl(os.path.join(folder, "mesh.stl"), obj, context.evaluated_depsgraph_get())
    else:
        current = scene.frame_current
        for frame in frames:
            scene.frame_set(frame)
            write_stl(os.path.join(folder, f"mesh.{frame:04d}.stl"), obj, context.evaluated_depsgraph_get())
        scene.frame_set(current)
    with open(job.recipe, "w", encoding="utf-8") as file:
        file.write(text(settings, scene.render.fps / scene.render.fps_base, frames))
    return job
