# SPDX-License-Identifier: MIT OR Apache-2.0
"""From a Blender object and the panel's settings to a folder with a mesh per frame and a recipe."""

import math
import os
import shutil
import struct
import tempfile

import bpy
import numpy

from . import motion

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
# Half widths of a narrow band that the program takes, in voxels.
MIN_BAND, MAX_BAND = 3, 64


def new_folder(parent, name):
    """A folder that was not there; Blender goes on showing what it read of a file, so that none is written twice."""
    for number in range(1000):
        folder = os.path.join(parent, name if number == 0 else f"{name}.{number:03d}")
        try:
            os.makedirs(folder)
        except FileExistsError:
            continue
        return folder
    raise ValueError(f"{parent} has 1000 fills of {name}; remove some")


class Job:
    """A folder with a recipe, and the files that its run writes; `frames` is None for a still.

    `moves` is whether the volumes hold velocities, `notes` what the user should know.
    """

    def __init__(self, name, settings, frames):
        self.is_temporary = not settings.folder
        if settings.folder.startswith("//") and not bpy.data.filepath:
            raise ValueError(f"the folder {settings.folder} is beside the .blend file: save it first, or name another")
        parent = tempfile.mkdtemp(prefix="druse-") if self.is_temporary else bpy.path.abspath(settings.folder)
        self.folder = new_folder(os.path.abspath(parent), bpy.path.clean_name(name))
        self.frames = frames
        self.recipe = os.path.join(self.folder, "part.toml")
        self.moves = False
        self.notes = []
        self.thickness, self.as_volume, self.as_mesh = settings.thickness, settings.as_volume, settings.as_mesh

    def path(self, suffix, frame=None):
        """The output with a suffix such as .vdb, at a frame of a sequence."""
        number = "" if self.frames is None else f".{(self.frames[0] if frame is None else frame):04d}"
        return os.path.join(self.folder, f"part{number}{suffix}")

    def discard(self):
        """Removes the folder of a run that brought nothing."""
        shutil.rmtree(os.path.dirname(self.folder) if self.is_temporary else self.folder, ignore_errors=True)


def surface(obj, depsgraph):
    """Points (n, 3) and triangles (m, 3) of the object with its modifiers, in world space, faces outward."""
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    evaluated = obj.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    if not mesh.loop_triangles:
        raise ValueError(f"{obj.name} has no faces; expected a closed mesh")
    points = numpy.empty(3 * len(mesh.vertices), dtype=numpy.float32)
    mesh.vertices.foreach_get("co", points)
    triangles = numpy.empty(3 * len(mesh.loop_triangles), dtype=numpy.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    matrix = numpy.array(evaluated.matrix_world)
    evaluated.to_mesh_clear()
    points = points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    triangles = triangles.reshape(-1, 3)
    if numpy.linalg.det(matrix[:3, :3]) < 0.0:
        triangles = triangles[:, ::-1]
    return points, triangles


def write_stl(path, points, triangles):
    """Writes binary STL."""
    rows = numpy.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    rows["corners"] = points[triangles]
    with open(path, "wb") as file:
        file.write(b"Druse".ljust(80, b" ") + struct.pack("<I", len(rows)) + rows.tobytes())


def text(job, settings, fps, half_width):
    """The recipe of the settings. The mesh cuts cubes; where it moves they follow it, and velocities are written."""
    token = "" if job.frames is None else ".$F4"
    mesh = f"mesh{token}.stl"
    is_sheet = settings.cell in SURFACES
    source = f'surface = "{settings.cell}"\nsolid = "sheet"' if is_sheet else f'graph = "{settings.cell}"'
    lines = ["druse = 1", 'unit = "m"', f"fps = {fps:g}", "[cell.cell]", 'element = "hex"', source, "[scaffold]"]
    if job.moves:
        lines += ['file = "cubes.vtk"', 'boundary = "extend"', "[scaffold.motion]", 'points = "cubes.pc2"']
    else:
        lines += [f'fill = {{ mesh = "{mesh}", cell_size = {settings.cell_size:.9g} }}', 'boundary = "extend"']
    lines += [
        "[tiling]",
        'cell = "cell"',
        f"thickness = {settings.thickness:.9g}",
        "[band]",
        f"voxel_size = {settings.voxel_size:.9g}",
        f"half_width = {half_width}",
        "[[op]]",
        f'intersect = {{ mesh = "{mesh}" }}',
    ]
    if settings.skin > 0.0:
        lines += ["[[op]]", f'union = {{ skin = {{ mesh = "{mesh}", thickness = {settings.skin:.9g} }} }}']
    lines += ["[[output]]", f'vdb = "part{token}.vdb"', "fog = true"]
    if job.moves:
        lines.append('grids = ["surface", "vel"]')
    if settings.as_mesh:
        lines += ["[[output]]", f'mesh = "part{token}.stl"']
    return "\n".join(lines) + "\n"


def band(job, step, scene, voxel_size):
    """Half width of the narrow band, in voxels: velocities reach as far as the shutter sees the surface."""
    # Blender before 4.2 has the position among the settings of Cycles.
    owner = scene.render if hasattr(scene.render, "motion_blur_position") else getattr(scene, "cycles", None)
    share = 0.5 if getattr(owner, "motion_blur_position", "CENTER") == "CENTER" else 1.0
    wanted = math.ceil(step * scene.render.motion_blur_shutter * share / voxel_size) + 2
    if wanted > MAX_BAND:
        job.notes.append(
            f"the mesh moves {wanted - 2} voxels within the shutter; motion blur reaches {MAX_BAND - 2} of them: "
            "use coarser voxels or a shorter shutter"
        )
    return min(max(wanted, MIN_BAND), MAX_BAND)


def write_sequence(context, obj, settings, job):
    """Writes a mesh per frame, and cubes that follow it if all have the same faces; returns the longest step."""
    scene = context.scene
    current = scene.frame_current
    binding = None
    try:
        for frame in job.frames:
            scene.frame_set(frame)
            mesh = surface(obj, context.evaluated_depsgraph_get())
            write_stl(os.path.join(job.folder, f"mesh.{frame:04d}.stl"), *mesh)
            if frame == job.frames[0]:
                # A single frame has no velocity.
                binding = motion.Binding(*mesh, settings.cell_size) if len(job.frames) > 1 else None
            elif binding and binding.fits(*mesh):
                binding.add(mesh[0])
            elif binding:
                binding = None
                job.notes.append(
                    f"the faces of {obj.name} change at frame {frame}: cells are made anew at every frame, and there "
                    "are no velocities for motion blur"
                )
    finally:
        scene.frame_set(current)
    if binding is None:
        return 0.0
    binding.write(job.folder, job.frames[0])
    job.moves = True
    return binding.greatest_step()


def write(context, obj, settings):
    """Writes the meshes and the recipe of an object; returns the job."""
    scene = context.scene
    frames = list(range(scene.frame_start, scene.frame_end + 1)) if settings.sequence else None
    if frames and not 0 <= frames[0] <= frames[-1] <= 9999:
        raise ValueError(f"frames {frames[0]} to {frames[-1]}; expected frames between 0 and 9999")
    job = Job(obj.name, settings, frames)
    step = 0.0
    try:
        if frames is None:
            write_stl(os.path.join(job.folder, "mesh.stl"), *surface(obj, context.evaluated_depsgraph_get()))
        else:
            step = write_sequence(context, obj, settings, job)
        half_width = band(job, step, scene, settings.voxel_size)
        with open(job.recipe, "w", encoding="utf-8") as file:
            file.write(text(job, settings, scene.render.fps / scene.render.fps_base, half_width))
    except (OSError, ValueError):
        job.discard()
        raise
    return job
