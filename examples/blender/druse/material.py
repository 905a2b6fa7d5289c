# SPDX-License-Identifier: MIT OR Apache-2.0
"""What a run wrote as objects: a volume with a shader of its fog, and a mesh."""

import os

import bpy


# Optical depth of a wall: light all but ends in it, so that it looks solid.
WALL_DEPTH = 12.0


def volume_material(thickness):
    """A material that shows the grid `density`, 1 inside, in Cycles and EEVEE."""
    material = bpy.data.materials.new("Druse Volume")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    shader = nodes.new("ShaderNodeVolumePrincipled")
    shader.location = (-300, 0)
    shader.inputs["Color"].default_value = (0.8, 0.75, 0.65, 1.0)
    shader.inputs["Density Attribute"].default_value = "density"
    shader.inputs["Density"].default_value = WALL_DEPTH / thickness
    links.new(shader.outputs["Volume"], output.inputs["Volume"])
    return material


def add_volume(context, job, name):
    """The volume of a job, as a sequence if it has frames; motion blur reads its velocities if the mesh moves."""
    data = bpy.data.volumes.new(name)
    data.filepath = job.path(".vdb")
    if job.moves and data.grids.load():
        # Before it is a sequence, since at another frame of the scene it has no grids that could be named.
        data.velocity_grid = "vel"
        # Metres per second.
        data.velocity_unit = "SECOND"
    if job.frames is not None:
        data.is_sequence = True
        data.frame_start = job.frames[0]
        data.frame_duration = len(job.frames)
        data.frame_offset = job.frames[0] - 1
    data.materials.append(volume_material(job.thickness))
    obj = bpy.data.objects.new(name, data)
    context.collection.objects.link(obj)
    return obj


def advice(scene, job):
    """What the user should set for motion blur, as a list of sentences."""
    if job.moves and not getattr(getattr(scene, "cycles", None), "volume_biased", True):
        return ["Cycles cuts motion blur at the surface of the volume unless Render > Volumes > Biased is set"]
    return []


def add_mesh(context, path, name):
    """The triangles of an STL file as an object."""
    before = set(bpy.data.objects)
    if hasattr(bpy.ops.wm, "stl_import"):
        bpy.ops.wm.stl_import(filepath=path, forward_axis="Y", up_axis="Z")
    else:
        bpy.ops.import_mesh.stl(filepath=path, axis_forward="Y", axis_up="Z")
    new = [o for o in bpy.data.objects if o not in before]
    for obj in new:
        obj.name = name
    return new[0]


def bring_in(context, job, name):
    """Adds the objects of a finished job; the mesh is that of the first frame."""
    if job.as_volume:
        add_volume(context, job, f"{name} volume")
    if job.as_mesh and os.path.exists(job.path(".stl")):
        add_mesh(context, job.path(".stl"), f"{name} mesh")
