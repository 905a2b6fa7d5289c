# SPDX-License-Identifier: MIT OR Apache-2.0
"""What a run wrote as objects: a volume with a shader of its fog, and a mesh."""

import os

import bpy


def volume_material():
    """A material that shows the grid `density` in Cycles and EEVEE; made once per file."""
    name = "Druse Volume"
    found = bpy.data.materials.get(name)
    if found:
        return found
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    shader = nodes.new("ShaderNodeVolumePrincipled")
    shader.location = (-300, 0)
    shader.inputs["Color"].default_value = (0.8, 0.75, 0.65, 1.0)
    shader.inputs["Density Attribute"].default_value = "density"
    # The fog is 1 inside; cells of a metre need this much to look solid.
    shader.inputs["Density"].default_value = 200.0
    links.new(shader.outputs["Volume"], output.inputs["Volume"])
    return material


def add_volume(context, job, name):
    """The volume of a job, as a sequence if it has frames. Motion blur reads the grid `vel` if there is one."""
    data = bpy.data.volumes.new(name)
    data.filepath = job.path(".vdb")
    if job.frames is not None:
        data.is_sequence = True
        data.frame_start = job.frames[0]
        data.frame_duration = len(job.frames)
        data.frame_offset = job.frames[0] - 1
    if data.grids.load() and any(grid.name == "vel" for grid in data.grids):
        data.velocity_grid = "vel"
        # Metres per second.
        data.velocity_unit = "SECOND"
    data.materials.append(volume_material())
    obj = bpy.data.objects.new(name, data)
    context.collection.objects.link(obj)
    return obj


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


def bring_in(context, job, name, settings):
    """Adds the objects of a finished job; the mesh is that of the first frame."""
    if settings.as_volume:
        add_volume(context, job, f"{name} volume")
    if settings.as_mesh and os.path.exists(job.path(".stl")):
        add_mesh(context, job.path(".stl"), f"{name} mesh")
