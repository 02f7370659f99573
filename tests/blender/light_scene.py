# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes whose baked light is compared with Cycles' own picture of the same surface, region by region.

The surface lies at z = 0 within [-1, 1]^2. The camera looks straight down on it from just above, below all that shadows
it, so that picture and bake show the same surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np

from patchnet.operators.cycles.bake import bake_luminance
from patchnet.operators.cycles.camera_render import render_reference
from patchnet.operators.scene.read import read_scene
from patchnet.operators.scene.scene_mesh import SceneMesh
from patchnet.operators.settings.groups import LightSettings
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.atlas_shade import atlas_shade
from patchnet.patchnet_addon.lightmap.denoised_atlas import denoised_atlas
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Fragments
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera

PIXELS = 16  # of the picture's side
FINER = 8  # texels a pixel's side: a texel shows one point at its edges, a pixel its mean
REGIONS = 8  # of the side that are compared
SQUARE = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


@dataclass(frozen=True, eq=False)
class Comparison:
    """baked, rendered: (REGIONS, REGIONS) luminance, row 0 at y = -1. noise: of each difference, standard deviation.

    warnings: what the bake said.
    """

    baked: np.ndarray
    rendered: np.ndarray
    noise: np.ndarray
    warnings: tuple[str, ...]

    @property
    def bright(self) -> float:
        """The brightest region's luminance."""
        return float(self.rendered.max())

    @property
    def agrees(self) -> bool:
        """Within four standard deviations, and 1 % of the brightest region for what shadow edges fall on texels."""
        return bool((np.abs(self.baked - self.rendered) < 4.0 * self.noise + 0.01 * self.bright).all())


def compare(samples: int = 128, names: Sequence[str] = ("Floor",)) -> Comparison:
    """Bake the objects `names` alone, denoised as by default, and render them, twice each, so that the noise is known.

    samples: paths a pixel, of the picture and, spread over its texels, of the bake.
    """
    select(names)
    source = read_scene(bpy.context.evaluated_depsgraph_get(), "SELECTED")
    texel_world, paths = 2.0 / PIXELS / FINER, -(-samples // FINER**2)
    light = LightSettings(samples=paths, color=False)
    assert light.denoise, "what users get"
    bakes = [drain(bake_luminance(bpy.context, source, texel_world, light, seed=seed)) for seed in (1, 2)]
    atlases = [denoised_atlas(bake, source) for bake in bakes]
    baked = [regions(luminance_at_points(source, atlas)) for atlas in atlases]
    rendered = [regions(picture(samples, seed)) for seed in (3, 4)]
    variance = sum(_smooth((one - other) ** 2) / 4.0 for one, other in (baked, rendered))
    return Comparison(sum(baked) / 2.0, sum(rendered) / 2.0, np.sqrt(variance), atlases[0].warnings)


def _smooth(values: np.ndarray) -> np.ndarray:
    """Means over 3 x 3 regions: one difference says little about the noise of its region."""
    padded = np.pad(values, 1, mode="reflect")
    return np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).mean(axis=(2, 3))


def assert_agrees(found: Comparison, contrast: float = 0.0) -> None:
    """The bake is what the picture shows, no region apart, in a scene with light, whose noise hides nothing.

    contrast: what the brightest region must be above the darkest, at least, as a share of it.
    """
    assert found.bright > 0.01, "there must be light"
    noise = found.noise.max() / found.bright
    assert noise < 0.015, f"{noise:.1%} noise are too much to compare: take more samples"
    assert 1.0 - found.rendered.min() / found.bright >= contrast, "the light must be uneven"
    assert found.agrees, f"\nbaked\n{found.baked.round(3)}\nrendered\n{found.rendered.round(3)}"


def select(names: Sequence[str]) -> None:
    """Select the objects of these names only."""
    bpy.context.view_layer.update()
    for item in bpy.context.view_layer.objects:
        item.select_set(item.name in names)


def picture(samples: int, seed: int, height: float = 0.02) -> np.ndarray:
    """(2, PIXELS, PIXELS): luminance as Cycles renders it from `height` above the surface, and coverage."""
    camera = Camera(
        np.array([0.0, 0.0, height]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, -1.0]),
        1.0, 1.0, PIXELS, PIXELS, ORTHOGRAPHIC,
    )  # fmt: skip
    reference = render_reference(bpy.context, camera, samples, seed)
    return np.stack([reference.luminance, reference.coverage])


def luminance_at_points(source: SceneMesh, atlas: Atlas) -> np.ndarray:
    """(2, side, side): baked luminance, and 1, at points as dense as texels; zero beside the surface."""
    shade = atlas_shade(atlas, source)
    side = PIXELS * FINER
    centres = (np.arange(side) + 0.5) / side * 2.0 - 1.0
    points = np.stack(np.meshgrid(centres, centres), axis=-1).reshape(-1, 2)
    result = np.zeros((2, len(points)), np.float32)
    for batch in source.batches():
        flat = np.flatnonzero((np.abs(batch.corners_world[:, :, 2]) < 1e-5).all(axis=1))
        for triangle in flat:
            first, second, third = batch.corners_world[triangle, :, :2]
            part = np.linalg.solve(np.stack([second - first, third - first], axis=1), (points - first).T).T
            inside = (part >= -1e-9).all(axis=1) & (part.sum(axis=1) <= 1.0 + 1e-9)
            count = int(inside.sum())
            fragments = Fragments(
                np.zeros(count, np.uint64), np.full(count, triangle, np.int32), part[inside].astype(np.float32),
                np.full(count, 1e-4),
            )  # fmt: skip
            result[0, inside], result[1, inside] = shade(batch, fragments)[0], 1.0
    return result.reshape(2, side, side)


def regions(pixels: np.ndarray) -> np.ndarray:
    """(REGIONS, REGIONS) means of luminance (2, N, N) over what is covered; zero where next to nothing is."""
    side = pixels.shape[-1] // REGIONS
    premultiplied, alpha = pixels.reshape(2, REGIONS, side, REGIONS, side).mean(axis=(2, 4))
    return np.where(alpha > 0.05, premultiplied / np.maximum(alpha, 0.05), 0.0)


def material(name: str = "Grey") -> tuple[bpy.types.Material, bpy.types.NodeTree]:
    """A material without nodes but its output, and its nodes."""
    result = bpy.data.materials.new(name)
    if result.node_tree is None:
        result.use_nodes = True
    result.node_tree.nodes.clear()
    result.node_tree.nodes.new("ShaderNodeOutputMaterial")
    return result, result.node_tree


def shader(tree: bpy.types.NodeTree, kind: str, **inputs: object) -> bpy.types.NodeSocket:
    """The output of a new shader node, e.g. "BsdfDiffuse"; inputs are values by name, spaces written as _."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return node.outputs[0]


def shown(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket) -> None:
    """Lead a shader to the material's output."""
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    tree.links.new(socket, output.inputs["Surface"])


def mixed(
    tree: bpy.types.NodeTree, first: bpy.types.NodeSocket, second: bpy.types.NodeSocket, factor: float
) -> bpy.types.NodeSocket:
    """A mix shader."""
    node = tree.nodes.new("ShaderNodeMixShader")
    node.inputs[0].default_value = factor
    tree.links.new(first, node.inputs[1])
    tree.links.new(second, node.inputs[2])
    return node.outputs[0]


def simple(kind: str = "BsdfDiffuse", name: str = "Grey", **inputs: object) -> bpy.types.Material:
    """A material of one shader."""
    result, tree = material(name)
    shown(tree, shader(tree, kind, **inputs))
    return result


def grey(value: float = 0.5) -> bpy.types.Material:
    """A diffuse material."""
    return simple(Color=(value, value, value, 1.0))


def link(item: bpy.types.Object, location: Sequence[float] = (0.0, 0.0, 0.0)) -> bpy.types.Object:
    """Put a new object into the scene."""
    item.location = location
    bpy.context.scene.collection.objects.link(item)
    return item


def mesh(name: str, vertices: list, faces: list, paint: bpy.types.Material | None = None) -> bpy.types.Object:
    """A new mesh object, in no scene yet."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    if paint:
        data.materials.append(paint)
    return bpy.data.objects.new(name, data)


def slab(name: str = "Floor", paint: bpy.types.Material | None = None, low: Sequence[float] = (-1, -1),
         high: Sequence[float] = (1, 1)) -> bpy.types.Object:  # fmt: skip
    """A closed box whose top lies at z = 0: it has no back side that light from below could reach."""
    vertices = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (-0.2, 0.0)]
    return link(mesh(name, vertices, CUBE_FACES, paint or grey()))


def pane(name: str, paint: bpy.types.Material, z: float = 0.5, scale: Sequence[float] = (1, 1, 1)) -> bpy.types.Object:
    """A square above the surface, which reaches to x = 0 only: half of the surface is in its shadow."""
    item = link(mesh(name, SQUARE, [(0, 1, 2, 3)], paint), (1.0, 0.0, z))
    item.scale = scale
    return item


def lamp(kind: str, energy: float, location: Sequence[float] = (0, 0, 1), **settings: object) -> bpy.types.Object:
    """A lamp that shines downwards."""
    light = bpy.data.lights.new(kind.title(), kind)
    light.energy = energy
    for name, value in settings.items():
        setattr(light, name, value)
    return link(bpy.data.objects.new(light.name, light), location)


def world() -> bpy.types.NodeTree:
    """A new world's nodes: a background that leads to the output."""
    result = bpy.data.worlds.new("World")
    if result.node_tree is None:
        result.use_nodes = True
    tree = result.node_tree
    tree.nodes.clear()
    background = tree.nodes.new("ShaderNodeBackground")
    tree.links.new(background.outputs[0], tree.nodes.new("ShaderNodeOutputWorld").inputs["Surface"])
    result.cycles.sampling_method, result.cycles.sample_map_resolution = "MANUAL", 256  # the usual map takes a second
    bpy.context.scene.world = result
    return tree
