# SPDX-License-Identifier: GPL-3.0-or-later
"""Cut-out planes: leaves of the octree have the image's gaps."""

import bpy
import numpy as np
import pytest

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


def plane(wiring: str) -> None:
    """A unit square whose alpha comes from an image, directly or through a Math node."""
    bpy.ops.mesh.primitive_plane_add(size=1.0, location=(0.5, 0.5, 0.0))
    material = bpy.data.materials.new("Leaf")
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("leaf", SIZE, SIZE, alpha=True)
    pixels = np.concatenate([np.full((SIZE, SIZE, 3), 0.5), opacity()[..., None]], axis=-1)
    texture.image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    texture.image.update()
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
    grid = Grid((-1e-7, -1e-7, -0.501), 1.0 + 2e-7, DEPTH)
    octree = drain(build_octree(source, grid, albedo_shade(source)))
    cells = octree.cells(DEPTH)
    areas = np.zeros((32, 32))
    np.add.at(areas, (cells[:, 1], cells[:, 0]), octree.area_world[octree.level(DEPTH)] * 4.0**DEPTH)
    return areas


def check(areas: np.ndarray, cutoff: float) -> None:
    truth = opacity()
    assert areas.sum() == pytest.approx((truth >= cutoff).sum(), rel=0.03)
    assert (areas[truth < 0.05] < 0.3).all() and (areas[1:7, 26:31] == 0).all(), "gaps and the veil are empty"
    assert (areas[truth > 0.95] > 0.7).all(), "what is opaque is there"
    assert (areas[8:24, 1:4] == 0).all(), "nothing left of the stem"
    assert ((areas > 0) == (truth > 0)).mean() > 0.85


@pytest.mark.parametrize("wiring", ["GREATER_THAN", "DIRECT"])
def test_plane_with_image_alpha_has_gaps(wiring: str) -> None:
    plane(wiring)
    check(coverage(read_scene(bpy.context.evaluated_depsgraph_get())), CUTOFF if wiring == "GREATER_THAN" else 0.5)
