# SPDX-License-Identifier: GPL-3.0-or-later
"""Small jobs that call every kernel of panel, render engine and viewport once; a script for Blender.

    blender -b --factory-startup -P small_jobs.py -- PACKAGE FOLDER SEARCH_PATH...

PACKAGE: the extension's name among modules, which compiled kernels carry in them; FOLDER: where it lies; SEARCH_PATH:
entries of sys.path of the calling Blender, with the extension's libraries.
"""

import importlib
import sys
import tempfile
from pathlib import Path
from types import ModuleType

import bpy

SMALL = {"scope": "VISIBLE", "resolution": "DEPTH", "depth": 5, "max_samples": 2, "size": (24, 16)}


def import_package(name: str, folder: str, search_path: list[str]) -> ModuleType:
    """Import the extension under its name, though its repository is not among any preferences."""
    sys.path += [entry for entry in search_path if entry not in sys.path]
    *parents, _ = name.split(".")
    for count in range(1, len(parents) + 1):
        parent = ModuleType(".".join(parents[:count]))
        parent.__path__ = []
        sys.modules[parent.__name__] = parent
    if parents:
        parent.__path__ = [str(Path(folder).parent)]
    return importlib.import_module(name)


def add_foliage() -> None:
    """Add a textured plane with gaps beside the cube of Blender's start-up file."""
    bpy.ops.mesh.primitive_plane_add(size=3.0, location=(0, 0, -1))
    image = bpy.data.images.new("Leaves", 8, 8, alpha=True)
    pixels = [0.5] * (8 * 8 * 4)
    pixels[3::8] = [0.0] * (8 * 4)
    image.pixels.foreach_set(pixels)
    material = bpy.data.materials.new("Leaves")
    if not material.node_tree:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture, shader = nodes.new("ShaderNodeTexImage"), nodes["Principled BSDF"]
    texture.image = image
    links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    links.new(texture.outputs["Alpha"], shader.inputs["Alpha"])
    bpy.context.object.data.materials.append(material)


def render() -> None:
    """Render a picture of the existing voxels with the render engine."""
    render = bpy.context.scene.render
    render.engine = "PATCHNET"
    render.resolution_x, render.resolution_y, render.resolution_percentage = 24, 16, 100
    bpy.ops.render.render()


def main(name: str, folder: str, *search_path: str) -> None:
    """Run the jobs."""
    import_package(name, folder, list(search_path)).register()
    add_foliage()
    for color in (False, True):
        done = bpy.ops.patchnet.run_all(light="cycles", color=color, **SMALL)
        if done != {"FINISHED"}:
            raise SystemExit(f"the job ended with {done}")
        render()
    with tempfile.TemporaryDirectory() as out:
        bpy.ops.patchnet.run_all(light="two-lights", out=str(Path(out) / "job"), **SMALL)


main(*sys.argv[sys.argv.index("--") + 1 :])
