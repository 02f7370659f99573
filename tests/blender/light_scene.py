# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes whose baked light is compared with Cycles' picture of the same surface, region by region.

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
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.operators.verify_light import CheckSettings, verify_light
from patchnet.patchnet_addon.lightmap.atlas import Atlas
from patchnet.patchnet_addon.lightmap.atlas_shade import atlas_shade
from patchnet.patchnet_addon.lightmap.denoised_atlas import denoised_atlas
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Fragments
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera

PIXELS = 16  # of the picture's side
FINER = 8  # texels a pixel's side: a texel shows one point at its edges, a pixel its mean
REGIONS = 8  # of the side that are compared


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


def mean_ratios(**settings: object) -> list[float]:
    """Mean luminance over that of Cycles, of each camera of a job."""
    job = JobSettings.of(depth=6, color=False, texel_voxels=1.0, **settings)
    check = drain(verify_light(bpy.context, CheckSettings(job, render_samples=64, rays=8)))
    return [camera["mean_ratio"] for camera in check.report["cameras"]]


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
            result[0, inside], result[1, inside] = shade(batch, at_points(triangle, part[inside]))[0], 1.0
    return result.reshape(2, side, side)


def at_points(triangle: int, points: np.ndarray) -> Fragments:
    """Fragments at points (N, 2) of a triangle, in units of its sides."""
    count = len(points)
    return Fragments(
        np.zeros(count, np.uint64), np.full(count, triangle, np.int32), points.astype(np.float32), np.full(count, 1e-4)
    )


def regions(pixels: np.ndarray) -> np.ndarray:
    """(REGIONS, REGIONS) means of luminance (2, N, N) over what is covered; zero where next to nothing is."""
    side = pixels.shape[-1] // REGIONS
    premultiplied, alpha = pixels.reshape(2, REGIONS, side, REGIONS, side).mean(axis=(2, 4))
    return np.where(alpha > 0.05, premultiplied / np.maximum(alpha, 0.05), 0.0)
