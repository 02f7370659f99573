# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut-out planes as the glTF importer and as users wire them: leaves of the octree have the image's gaps."""

import base64
import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet.operators.scene.files import open_scene
from patchnet.operators.scene.read import read_scene
from patchnet.operators.scene.scene_mesh import SceneMesh
from patchnet.patchnet_addon.octree.build import build_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.shading import albedo_shade

pytestmark = pytest.mark.usefixtures("empty_scene")

SIZE = 32
DEPTH = 5
CUTOFF = 0.4


def opacity() -> np.ndarray:
    """(32, 32) float, row 0 at v = 0: a disc off the centre, a stem, and a faint veil in one corner."""
    y, x = (np.mgrid[0:SIZE, 0:SIZE] + 0.5) / SIZE
    disc = np.clip((0.25 - np.hypot(x - 0.65, y - 0.6)) * 16 + 0.5, 0, 1)
    stem = (abs(x - 0.2) < 0.05) & (y < 0.8)
    veil = 0.25 * ((x > 0.8) & (y < 0.2))
    return np.maximum.reduce([disc, stem, veil])


def rgba() -> np.ndarray:
    return np.concatenate([np.full((SIZE, SIZE, 3), 0.5), opacity()[..., None]], axis=-1)


def image() -> bpy.types.Image:
    result = bpy.data.images.new("leaf", SIZE, SIZE, alpha=True)
    result.pixels.foreach_set(rgba().astype(np.float32).ravel())
    result.update()
    return result


def gltf(path: Path, mode: str) -> None:
    """A unit square whose base colour texture has alpha."""
    picture = image()
    picture.filepath_raw, picture.file_format = str(path.with_suffix(".png")), "PNG"
    picture.save()
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    uvs = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # glTF counts from the top
    data = corners.tobytes() + uvs.tobytes() + np.array([0, 1, 2, 0, 2, 3], np.uint16).tobytes()
    material = {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [material | ({"alphaCutoff": CUTOFF} if mode == "MASK" else {})],
        "textures": [{"source": 0}],
        "images": [{"uri": path.with_suffix(".png").name}],
        "buffers": [
            {"byteLength": 92, "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 32},
            {"buffer": 0, "byteOffset": 80, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
    }
    path.write_text(json.dumps(document))


def plane(wiring: str) -> None:
    """A unit square whose alpha comes from an image, directly or through a Math node."""
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0.5, 0.5, 0.0))
    material = bpy.data.materials.new("Leaf")
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = image()
    links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    found = texture.outputs["Alpha"]
    if wiring == "GREATER_THAN":
        math = nodes.new("ShaderNodeMath")
        math.operation, math.inputs[1].default_value = wiring, CUTOFF
        links.new(found, math.inputs[0])
        found = math.outputs[0]
    links.new(found, shader.inputs["Alpha"])
    bpy.context.object.data.materials.append(material)


def coverage(source: SceneMesh) -> np.ndarray:
    """Opaque area (32, 32) of the voxels of the plane, in voxel faces; one voxel a texel. Row 0 is the lowest."""
    low, high = source.bounds_world
    flat = int(np.argmin(high - low))  # z, or y of an imported glTF, which is turned from y up to z up
    origin = [float(value) for value in np.where(np.arange(3) == flat, low - 0.501, low - 1e-7)]
    grid = Grid((origin[0], origin[1], origin[2]), 1.0 + 2e-7, DEPTH)
    octree = drain(build_octree(source, grid, albedo_shade(source)))
    cells = octree.cells(DEPTH)
    areas = np.zeros((32, 32))
    np.add.at(areas, (cells[:, 3 - flat], cells[:, 0]), octree.area_world[octree.level(DEPTH)] * 4.0**DEPTH)
    return areas


def check(areas: np.ndarray, cutoff: float) -> None:
    truth = opacity()
    assert areas.sum() == pytest.approx((truth >= cutoff).sum(), rel=0.03)
    assert (areas[truth < 0.05] < 0.3).all() and (areas[1:7, 26:31] == 0).all(), "gaps and the veil are empty"
    assert (areas[truth > 0.95] > 0.7).all(), "what is opaque is there"
    assert (areas[8:24, 1:4] == 0).all(), "nothing left of the stem"
    assert ((areas > 0) == (truth > 0)).mean() > 0.85


@pytest.mark.parametrize("mode", ["MASK", "BLEND"])
def test_imported_gltf_has_gaps(tmp_path: Path, mode: str) -> None:
    gltf(tmp_path / "leaf.gltf", mode)
    open_scene(tmp_path / "leaf.gltf")
    source = read_scene(bpy.context.evaluated_depsgraph_get())
    cutoff = CUTOFF if mode == "MASK" else 0.5
    assert len(source.warnings) == (mode == "BLEND"), "a veil is named"
    assert source.materials[0].alpha_threshold == pytest.approx(cutoff)
    check(coverage(source), cutoff)


@pytest.mark.parametrize("wiring", ["GREATER_THAN", "DIRECT"])
def test_plane_with_image_alpha_has_gaps(wiring: str) -> None:
    plane(wiring)
    check(coverage(read_scene(bpy.context.evaluated_depsgraph_get())), CUTOFF if wiring == "GREATER_THAN" else 0.5)
