# SPDX-License-Identifier: GPL-3.0-or-later
"""Small scenes whose baked light is known at places of their surface, or compared with Cycles' picture of it.

The surface that is compared lies at z = 0 within [-1, 1]^2. The camera looks straight down on it from just above, below
all that shadows it, so that picture and bake show the same surface.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import bpy
import numpy as np
import pytest

from patchnet.operators.computing.octrees import LitSurface
from patchnet.operators.cycles.bake import BakeJob, bake_light, baker
from patchnet.operators.cycles.bake.bake_call import BakeTarget
from patchnet.operators.cycles.bake.bake_job import begin
from patchnet.operators.cycles.bake.baker import SurfelBaker
from patchnet.operators.cycles.camera_render import render_reference
from patchnet.operators.pipeline.lit_octree import LitOctree, build_lit_octree
from patchnet.operators.scene.cameras import choose_cameras
from patchnet.operators.settings.groups import LightSettings
from patchnet.operators.settings.job_settings import JobSettings
from patchnet.operators.verify_light import CheckSettings, LightCheck, verify_light
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.process.computed import answer
from patchnet.patchnet_addon.process.transfer import Remote
from patchnet.patchnet_addon.runtime.progress import Progress, drain
from patchnet.patchnet_addon.runtime.stage_clock import StageClock
from patchnet.patchnet_addon.surface.scene_mesh import SceneMesh
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera
from patchnet.tests.blender.objects import read
from patchnet.tests.references.baked import clip_evenly, read_fragments, read_surfels

PIXELS = 16  # of the picture's side
REGIONS = 8  # of the side that are compared
DEPTHS = 7, 8  # of the two bakes that are compared, which share no surfel
LOOKAHEAD = 2
ALL_PATHS = 1e-4  # noise threshold with which all surfels get all paths
_EDGE = 1e-4  # of the square: fragments at its very edge lie in the voxels beside it


class LitFragments(NamedTuple):
    """Light of F fragments: names of their objects (F,), triangles (F,) of the surface, places (F, 3) and areas (F,) in
    the world, luminance and opacity (F,), and luminance (F, 2) of front and back.
    """

    names: np.ndarray
    triangle: np.ndarray
    place: np.ndarray
    area: np.ndarray
    luminance: np.ndarray
    opacity: np.ndarray
    sides: np.ndarray

    def of(self, name: str) -> "LitFragments":
        """Fragments of one object."""
        return self.only(self.names == name)

    def only(self, chosen: np.ndarray) -> "LitFragments":
        """Fragments where `chosen` (F,) is true."""
        return LitFragments(*(column[chosen] for column in self))

    @property
    def mean(self) -> float:
        """Mean luminance over the surface."""
        return float(np.average(self.luminance, weights=self.area))

    @property
    def mean_sides(self) -> np.ndarray:
        """Mean luminance of front and back (2,) over the surface."""
        return np.average(self.sides, axis=0, weights=self.area)


@dataclass(frozen=True, eq=False)
class Baked:
    """Surface in its voxels, and its baked light."""

    source: SceneMesh
    clipped: Remote
    light: LitSurface

    @cached_property
    def fragments(self) -> LitFragments:
        """Light of all fragments, as the octree takes it."""
        found = answer(read_fragments, self.clipped, self.light.light)
        return LitFragments(self.source.objects_of(found[0]), *found)


def bake_job(
    scope: str = "VISIBLE", depth: int = 5, cameras: Sequence[str] = (), state: str = "", **light: object
) -> BakeJob:
    """Job on the open scene: as fine as the voxels everywhere, or as cameras of these names see it.

    light: settings; without colour unless they say so.
    """
    source = read(scope)
    light = {"color": False, "noise_threshold": ALL_PATHS, "cells": "seen" if cameras else "everywhere"} | light
    return job_on(source, LightSettings(**light), depth, cameras, state)


def job_on(
    source: SceneMesh, light: LightSettings, depth: int = 5, cameras: Sequence[str] = (), state: str = ""
) -> BakeJob:
    """Job on a surface of the open scene."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    looking = tuple(choose_cameras(depsgraph, cameras, (32, 24), source.bounds_world)) if cameras else ()
    grid = Grid.around(source.bounds_world, depth)
    clipped = answer(clip_evenly, source, grid, light.color)
    return BakeJob(bpy.context, source, clipped, grid, looking, light, LOOKAHEAD, state=state)


def finished(job: BakeJob) -> Baked:
    """Bake to the end."""
    return Baked(job.source, job.clipped, drain(bake_light(job)))


def bake(scope: str = "VISIBLE", depth: int = 5, cameras: Sequence[str] = (), **light: object) -> Baked:
    """Bake the light of the open scene, see `bake_job`; nothing is kept."""
    return finished(bake_job(scope, depth, cameras, **light))


def on_bake(monkeypatch: pytest.MonkeyPatch, see: Callable[[BakeTarget], object]) -> None:
    """Call a function with each target before Blender bakes it, while a test runs."""
    run = baker.bake_now

    def seen(context: bpy.types.Context, target: BakeTarget) -> None:
        see(target)
        run(context, target)

    monkeypatch.setattr(baker, "bake_now", seen)


class BakedSurfels(NamedTuple):
    """Light of N surfels as Cycles computes it, before it is filtered and looked up.

    surfels: (N,) SURFEL. names: (N,) of their objects. place: (N, 3) in the world. luminance, half: (N,), mean of
    both parts and half their difference, times opacity. warnings: what was left out.
    """

    surfels: np.ndarray
    names: np.ndarray
    place: np.ndarray
    luminance: np.ndarray
    half: np.ndarray
    warnings: tuple[str, ...]

    def only(self, chosen: np.ndarray) -> "BakedSurfels":
        """Surfels where `chosen` (N,) is true."""
        return BakedSurfels(*(column[chosen] for column in self[:-1]), self.warnings)


def bake_surfels(samples: int, depth: int = 5, seed: int = 0, **light: object) -> BakedSurfels:
    """Bake the surfels of the open scene by so many paths each."""
    job = bake_job(depth=depth, **light)
    surfels, place = answer(read_surfels, drain(begin(job)).bake)
    baker = SurfelBaker(bpy.context, job.source, job.light, job.grid.side_world)
    light_of = drain(baker.bake(surfels, samples, seed, Progress(0, 1, "Baking light")))
    names = job.source.objects_of(surfels["triangle"])
    return BakedSurfels(surfels, names, place, light_of[:, 0], light_of[:, -1], baker.warnings)


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


def lit(**settings: object) -> LitOctree:
    """Octree of the open scene in the light of a job."""
    bpy.context.view_layer.update()
    return drain(build_lit_octree(bpy.context, JobSettings.of(**settings), StageClock()))


def checked(*, render_samples: int = 64, rays: int = 8, **settings: object) -> LightCheck:
    """Light of a job's cameras, compared with Cycles."""
    bpy.context.view_layer.update()
    job = CheckSettings(JobSettings.of(**settings), render_samples=render_samples, rays=rays)
    return drain(verify_light(bpy.context, job))


def assert_as_cycles(check: LightCheck, psnr_db: float, ratio: float) -> None:
    """The only camera sees the picture that Cycles renders, up to so much, and is as bright up to a share."""
    (seen,) = check.report["cameras"]
    assert seen["psnr_db"] > psnr_db and abs(seen["mean_ratio"] - 1.0) < ratio, (seen, check.report["warnings"])


def mean_ratios(**settings: object) -> list[float]:
    """Mean luminance over that of Cycles, of each camera of a job."""
    return [camera["mean_ratio"] for camera in checked(**{"depth": 6, "color": False, **settings}).report["cameras"]]


def compare(samples: int = 128, names: Sequence[str] = ("Floor",)) -> Comparison:
    """Bake the objects `names` alone, with all defaults, and render them, twice each, so that the noise is known.

    samples: paths a pixel of the picture.
    """
    select(names)
    baked, warnings = [], ()
    for depth in DEPTHS:
        found = bake("SELECTED", depth)
        assert JobSettings.of().light.denoise, "what users get"
        warnings = found.light.warnings
        baked.append(light_of_regions(found.fragments))
    rendered = [regions(picture(samples, seed)) for seed in (3, 4)]
    variance = sum(_smooth((one - other) ** 2) / 4.0 for one, other in (baked, rendered))
    return Comparison(sum(baked) / 2.0, sum(rendered) / 2.0, np.sqrt(variance), warnings)


def light_of_regions(found: LitFragments) -> np.ndarray:
    """(REGIONS, REGIONS) mean luminance of the fragments at z = 0; zero where next to nothing is."""
    flat = found.only((np.abs(found.place) < (1.0 - _EDGE, 1.0 - _EDGE, 1e-5)).all(axis=1))
    at = ((flat.place[:, :2] + 1.0) / 2.0 * REGIONS).astype(int)
    number = at[:, 1] * REGIONS + at[:, 0]
    area, light = (
        np.bincount(number, values, REGIONS**2).reshape(REGIONS, REGIONS)
        for values in (flat.area * flat.opacity, flat.area * flat.opacity * flat.luminance)
    )
    return np.where(area > 0.05 * 4.0 / REGIONS**2, light / np.maximum(area, 1e-30), 0.0)


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
    # Within four standard deviations, and 1 % of the brightest region for what shadow edges fall on cells.
    agrees = np.abs(found.baked - found.rendered) < 4.0 * found.noise + 0.01 * found.bright
    assert agrees.all(), f"\nbaked\n{found.baked.round(3)}\nrendered\n{found.rendered.round(3)}"


def assert_mean_of_views(paint: bpy.types.Material, samples: int, *, paths: int = 16, rel: float) -> BakedSurfels:
    """Bake a ball of a material, which is as bright as Cycles' picture of it on the mean.

    On its disc all angles are seen as often as a view of a surface has them.
    """
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32, radius=0.98)
    bpy.context.object.data.materials.append(paint)
    bpy.ops.object.shade_smooth()
    found = bake_surfels(paths)
    light, alpha = picture(samples, 1, height=1.5)
    assert found.luminance.mean() == pytest.approx(light.sum() / alpha.sum(), rel=rel)
    return found


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


def regions(pixels: np.ndarray) -> np.ndarray:
    """(REGIONS, REGIONS) means of luminance (2, N, N) over what is covered; zero where next to nothing is."""
    side = pixels.shape[-1] // REGIONS
    premultiplied, alpha = pixels.reshape(2, REGIONS, side, REGIONS, side).mean(axis=(2, 4))
    return np.where(alpha > 0.05, premultiplied / np.maximum(alpha, 0.05), 0.0)
