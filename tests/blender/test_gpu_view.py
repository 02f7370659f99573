# SPDX-License-Identifier: GPL-3.0-or-later
"""Octree and decoder on the graphics card, in Blender's module `gpu`, against the kernels of the CPU."""

import gc
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import bpy
import numpy as np
import pytest

from patchnet.operators.gpu_view import card_octree, cards
from patchnet.operators.gpu_view.card_octree import CardOctree, Samples
from patchnet.operators.gpu_view.cards import BlenderDevice
from patchnet.operators.gpu_view.packing import world_words
from patchnet.operators.gpu_view.shaders import FLOATS, WORDS
from patchnet.operators.properties.preferences import VIEWPORT_CARD, VIEWPORT_CPU, Preferences
from patchnet.operators.render_engine.viewport_card import CardHeat, HeatKind, strategy_on_card
from patchnet.patchnet_addon.codes.coded_octree import CodedOctree
from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.codes.predict import predict
from patchnet.patchnet_addon.image.colormaps import colormap
from patchnet.patchnet_addon.image.cube_map import CubeMap, pixel_directions
from patchnet.patchnet_addon.image.tone import srgb_encode
from patchnet.patchnet_addon.lod.fit import fit_leaf_levels
from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.octree.build import build_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.octree.voxelize import LeafDetail
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.adaptive import AdaptivePicture
from patchnet.patchnet_addon.sampling.patchnet import coverage_and_luminance_score
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleBatch, TriangleMesh
from patchnet.patchnet_addon.surface.shading import albedo_shade, two_lights_shade
from patchnet.patchnet_addon.surface.texture_lookup import BaseColors
from patchnet.patchnet_addon.surface.textures import TextureTable
from patchnet.patchnet_addon.tracing.camera import ORTHOGRAPHIC, Camera, camera_in_unit_cube
from patchnet.patchnet_addon.tracing.pixel_filter import BLACKMAN_HARRIS, BOX_FILTER, GAUSSIAN, PixelFilter, rook_places
from patchnet.patchnet_addon.tracing.render import first_hits, seen_above_white, seen_color
from patchnet.patchnet_addon.tracing.supersample import supersample_pixels
from patchnet.tests.blender.gpu_context import with_gpu
from patchnet.tests.engine.octree_samples import random_octree, with_sides
from patchnet.tests.engine.yard_scene import yard_octree
from patchnet.training.benchmarks.shells import shell_triangles
from patchnet.training.commands.benches.gpu import compare_estimates, compare_with

pytestmark = pytest.mark.usefixtures("registered")

SIZE = 256, 256
MIDDLE = np.full((3, 2), 0.5)  # of a pixel, for three rays


@pytest.fixture(scope="module")
def yard() -> CodedOctree:
    """A yard with boxes, sides, random hues, and lights above white."""
    octree = with_sides(yard_octree())
    random = np.random.default_rng(1)
    roots = 255 * np.sqrt(octree.luminance_float(octree.side_nodes))[:, None]
    light = np.clip(roots + random.uniform(-60, 60, octree.side_light.shape), 0, 255).astype(np.uint8)
    nodes = np.flatnonzero(random.random(octree.node_count) < 0.1).astype(np.uint32)
    octree = replace(
        octree,
        side_light=light,
        chroma=random.integers(20, 120, (octree.node_count, 2)).astype(np.uint8),
        side_chroma=random.integers(20, 120, (len(octree.side_nodes), 6, 2)).astype(np.uint8),
        bright_nodes=nodes,
        bright_colors=random.uniform(0, 4, (len(nodes), 3)).astype(np.float32),
    )
    return drain(encode_octree(octree, load_weights()))


def cameras() -> list[Camera]:
    """Cameras far, near, shifted, orthographic; no ray runs along an edge or a diagonal, where the last bit decides."""

    def look(name: str, place: tuple[float, ...], target: tuple[float, ...], **changes: Any) -> Camera:
        camera = Camera.look_at(np.array(place), np.array(target), size_px=SIZE, name=name)
        return replace(camera, **changes)

    return [
        look("far", (1.91, -1.33, 1.17), (0.52, 0.47, 0.13)),
        look("near", (0.83, 0.11, 0.33), (0.37, 0.71, 0.09), clip_start=0.05, clip_end=0.9),
        look(
            "shifted", (-0.71, 0.17, 0.45), (0.51, 0.49, 0.15), width_px=250, height_px=150, shift_x=0.2, shift_y=-0.1
        ),
        look("orthographic", (2.3, -1.7, 1.9), (0.5, 0.5, 0.1), kind=ORTHOGRAPHIC, half_x=0.7, half_y=0.7),
    ]


def card_of(octree: Octree, *shaders: str, coded: CodedOctree | None = None) -> CardOctree:
    """The octree on the card, with its codes, and shaders."""
    card = CardOctree(BlenderDevice(), octree)
    drain(card.upload(octree))
    if coded is not None:
        drain(card.upload_codes(coded))
    drain(card.compile(*shaders))
    return card


def on_card(coded: CodedOctree, cameras: list[Camera]) -> list[tuple[np.ndarray, ...]]:
    """Nodes (H, W) uint32, what the decoder and the estimator write (H, W, 4), of each camera."""

    def work() -> Iterator[tuple[np.ndarray, ...]]:
        card = card_of(coded.octree, "hits", "decoder", "estimate", coded=coded)
        device = card.device
        for camera in cameras:
            unit = camera_in_unit_cube(camera, coded.octree.grid)
            hits = card.hit_images(unit)
            decoded, scored = (device.image(unit.width_px, unit.height_px, FLOATS) for _ in range(2))
            card.trace(unit, hits)
            half = unit.height_px // 2
            card.decode(unit, hits, decoded, (0, half))
            card.decode(unit, hits, decoded, (half, unit.height_px - half))
            card.estimate(unit, hits, decoded, scored, (0, half - 1))
            card.estimate(unit, hits, decoded, scored, (half - 1, unit.height_px - half + 1))
            yield device.read(hits.node, WORDS), device.read(decoded, FLOATS), device.read(scored, FLOATS)

    return with_gpu(lambda: list(work()))


def check(coded: CodedOctree, cameras: list[Camera]) -> None:
    """Compare all pixels with the CPU's."""
    for camera, (node, decoded, scored) in zip(cameras, on_card(coded, cameras), strict=True):
        hits = first_hits(coded.octree, camera)
        look_ahead = predict(coded, hits).look_ahead
        found: dict[str, Any] = compare_with(coded, hits, look_ahead, node, decoded)
        assert found["same_nodes"] >= 0.9999, camera.name
        assert ((decoded[..., 2].ravel() > 0) == look_ahead).mean() >= 0.9999
        assert hits.hit.any()
        if look_ahead.any():
            assert found["coverage"] < 5e-4 and found["luminance"] < 2e-3 and found["order"] >= 0.999, camera.name
        np.testing.assert_array_equal(scored[..., :3], decoded[..., :3])
        estimates: dict[str, Any] = compare_estimates(coded, camera, scored)
        assert estimates["estimate_order"] >= 0.999 and estimates["estimate_off"] < 1e-3, camera.name


def test_hits_and_predictions_are_those_of_the_kernels(yard: CodedOctree) -> None:
    check(yard, cameras())


def test_a_fitted_octree_of_depth_16() -> None:
    mesh = TriangleMesh.from_arrays(shell_triangles(1.0))
    camera = Camera.look_at(np.array([1.012, 0.0031, 0.0017]), np.array([0.7, 0.11, 0.05]), size_px=SIZE)
    shade = two_lights_shade(mesh)
    fitted = drain(fit_leaf_levels(mesh, Grid.around(mesh.bounds_world, 9), [camera], shade, deepest=16))
    octree = drain(build_octree(mesh, Grid.around(mesh.bounds_world, 16), shade, layout=fitted.layout))
    assert octree.depth == 16
    check(drain(encode_octree(octree, load_weights())), [camera])


def patterned() -> TriangleMesh:
    """Triangles in all directions, with colours, cut-outs and UV coordinates beyond the images in all wrap modes."""
    random = np.random.default_rng(3)

    def image(*shape: int, wrap: str) -> Texture:
        return Texture("noise", random.random(shape, np.float32), wrap)

    modes = ("REPEAT", "EXTEND", "MIRROR", "CLIP")
    materials = [Material(mode, (1.0,) * 3, base_texture=image(32, 16, 3, wrap=mode)) for mode in modes]
    cut_outs = [image(2, 3, 1, wrap=mode) for mode in modes]
    materials += [Material(cut.wrap, alpha_texture=cut, alpha_threshold=0.5) for cut in cut_outs]
    materials += [Material("green", (0.2, 0.7, 0.1))]
    places = random.uniform(0.2, 0.8, (60, 1, 3)) + random.normal(0.0, 0.12, (60, 3, 3))
    uvs = random.uniform(-0.75, 1.75, (60, 3, 2)).astype(np.float32)
    number = np.arange(60, dtype=np.int32) % len(materials)
    part = TriangleBatch(np.clip(places, 0.01, 0.99), uvs, number, 0)
    return TriangleMesh((part,), tuple(materials))


def with_pieces(mesh: TriangleMesh, depth: int) -> Octree:
    """Octree whose leaves have pieces; of more than six levels it has leaves on all of them."""
    table, reflects = TextureTable.from_materials(mesh.materials, color=True), np.ones(len(mesh.materials), bool)
    layout = None if depth == 6 else LeafLevels(np.random.default_rng(1).integers(4, depth + 1, 64).astype(np.uint8))
    return drain(
        build_octree(
            mesh,
            Grid((0.0, 0.0, 0.0), 1.0, depth),
            albedo_shade(mesh, color=True),
            exposure=0.5,
            layout=layout,
            detail=LeafDetail(boxes=True, base=BaseColors(table, reflects)),
        )
    )


@pytest.mark.parametrize("depth", [6, 12])
def test_rays_of_pictures_end_on_pieces_as_those_of_the_kernels(depth: int) -> None:
    """Base colours and cut-outs included; leaves of depth 12 are a 500th of a triangle."""
    octree = with_pieces(patterned(), depth)
    for camera in (camera.with_size(128, 96) for camera in cameras()):
        for footprint in (4.0, 16.0):
            found = exact_on_card(octree, camera, footprint)
            pixels = np.arange(camera.pixel_count)
            means = supersample_pixels(octree, camera, pixels, 1, finer=footprint)
            expected = np.column_stack([means.colors / octree.exposure, means.coverage])
            off = np.abs(found - expected).max(axis=1)
            assert (off > 1e-3).mean() <= 2e-4 and expected[:, 3].mean() > 0.05, camera.name
            boxes = exact_on_card(octree.without_pieces(), camera, footprint)
            assert (np.abs(boxes - expected).max(axis=1) > 0.01).mean() > 0.03, camera.name


def test_partial_opacity_is_the_share_of_rays_on_the_card() -> None:
    mesh = patterned()
    glass = tuple(Material("glass", alpha=0.3) for _ in mesh.materials)
    octree, solid = with_pieces(TriangleMesh(mesh.parts, glass), 6), with_pieces(patterned(), 6)
    camera = replace(cameras()[3], half_x=0.1, half_y=0.1)
    share = exact_on_card(octree, camera, 16.0)[:, 3].mean()
    means = supersample_pixels(octree, camera, np.arange(camera.pixel_count), 1, finer=16.0)
    assert share == pytest.approx(means.coverage.mean(), abs=0.01)
    assert share < exact_on_card(solid, camera, 16.0)[:, 3].mean() - 0.2


def exact_on_card(octree: Octree, camera: Camera, finer: float) -> np.ndarray:
    """Picture (P, 4) of one ray a pixel, as wide on voxels as a pixel over `finer`."""
    return picture_on_card(octree, camera, places=MIDDLE[:1], finer=finer, footprint=finer)


def picture_on_card(
    octree: Octree, camera: Camera, world: CubeMap | np.ndarray | None = None, pixel_filter: PixelFilter = BOX_FILTER,
    *, places: np.ndarray = MIDDLE, finer: float = 1.0, footprint: float = 1.0,
) -> np.ndarray:  # fmt: skip
    """Mean (P, 4) of rays at places (N, 2) of each pixel, as wide on voxels as a pixel over `finer`.

    footprint: of a ray on textures over that on voxels.
    """

    def work() -> np.ndarray:
        card = card_of(octree, "picture", "film")
        device, unit = card.device, camera_in_unit_cube(camera, card.grid).finer(finer)
        seen, one, two = (device.image(unit.width_px, unit.height_px, FLOATS) for _ in range(3))
        words, side = world_words(world)
        behind, samples = (device.texture(words), side), Samples.of(device, pixel_filter, places)
        for number in range(len(places)):
            card.draw(unit, (seen, one, two), behind, samples, number, footprint)
            one, two = two, one
        return device.read(one, FLOATS).reshape(-1, 4)

    return with_gpu(work)


@pytest.mark.parametrize(
    "pixel_filter", [PixelFilter(BLACKMAN_HARRIS, 1.5), PixelFilter(GAUSSIAN, 2.0), PixelFilter(BLACKMAN_HARRIS, 0.01)]
)
def test_pictures_through_a_filter_are_those_of_the_kernels(yard: CodedOctree, pixel_filter: PixelFilter) -> None:
    octree, camera = yard.octree, cameras()[0].with_size(128, 96)
    picture = AdaptivePicture(octree, camera, None, pixel_filter=pixel_filter)
    drain(picture.trace())
    drain(picture.sample_evenly(4))
    places = np.random.default_rng(0).permutation(rook_places(4))
    found = picture_on_card(octree, camera, None, pixel_filter, places=places, finer=16)
    expected = picture.values / np.array([*[octree.exposure] * 3, 1.0])
    off = np.abs(found - expected).max(axis=1)
    assert (off > 1 / 255).mean() <= 3e-3 and off.mean() < 1e-4


@pytest.mark.parametrize("kind", ["map", "color", "transparent"])
def test_colors_and_the_world_behind_are_those_of_the_kernels(yard: CodedOctree, kind: str) -> None:
    octree, camera = yard.octree, cameras()[0].with_size(256, 192)
    faces = np.random.default_rng(2).uniform(0, 2, (6, 8, 8, 3)).astype(np.float16)
    world = {"map": CubeMap(faces), "color": np.array([0.25, 0.5, 1.0], np.float32), "transparent": None}[kind]
    found, hits = picture_on_card(octree, camera, world), first_hits(octree, camera)
    colors = seen_color(octree, hits.node, hits.direction) + seen_above_white(octree, hits)
    if world is not None:
        behind = world.look(pixel_directions(camera)) if isinstance(world, CubeMap) else world
        colors = np.where(hits.hit[:, None], colors, behind)
    wrong = np.abs(found[:, :3] - colors).max(axis=1) > 1 / 255
    assert wrong.mean() <= 1e-4 and (found[:, 3] == (hits.hit if world is None else 1)).mean() >= 0.9999


def heat_on_card(coded: CodedOctree, camera: Camera, kind: int) -> np.ndarray:
    """Heatmap (P, 4) of a view, whose ramp is gray and ends at 1."""

    def work() -> np.ndarray:
        card = card_of(coded.octree, "hits", "decoder", "heat", coded=coded)
        device = card.device
        unit = camera_in_unit_cube(camera, coded.octree.grid)
        hits, (decoded, heat) = card.hit_images(unit), (device.image(*SIZE, FLOATS) for _ in range(2))
        card.trace(unit, hits)
        card.decode(unit, hits, decoded)
        ramp = np.repeat(np.linspace(0, 1, 256, dtype=np.float32)[:, None], 4, axis=1)
        card.heat(unit, hits, decoded, device.texture(ramp.view(np.uint32)), (kind, 1.0), heat)
        return device.read(heat, FLOATS).reshape(-1, 4)

    return with_gpu(work)


@pytest.mark.parametrize(("kind", "name"), [(1, "priority"), (2, "coverage"), (3, "predicted")])
def test_heatmaps_are_those_of_the_kernels(yard: CodedOctree, kind: int, name: str) -> None:
    camera = cameras()[0]
    view = drain(trace_view(yard.octree, camera, [STRATEGIES["patchnet-behind"]], coded=yard, reference=False))
    assert view.prediction is not None and view.predicted is not None
    score = coverage_and_luminance_score(view, view.prediction)
    expected = {"priority": score, "coverage": view.prediction.coverage, "predicted": srgb_encode(view.predicted)}[name]
    found = heat_on_card(yard, camera, kind)
    assert ((found[:, 3] > 0) == view.hit).mean() >= 0.9999
    off = np.abs(found[view.hit, 0] - np.clip(expected, 0, 1)[view.hit])
    assert (off > 1.5 / 255).mean() < 1e-3


def test_live_priority_is_by_the_estimator_or_the_paper(yard: CodedOctree) -> None:
    """In bands it is as in one go, and pixels that are inspected have the CPU's."""
    camera = cameras()[0].with_size(96, 80)
    plus, paper, no_ray = (STRATEGIES[name] for name in ("patchnet-plus", "patchnet", "patchnet-plus-0"))

    def work() -> tuple[np.ndarray, np.ndarray, list[list[str]]]:
        card = card_of(yard.octree, "hits", "decoder", "estimate", "heat", coded=yard)
        device = card.device
        assert strategy_on_card(no_ray, card) == (no_ray, "Priority by PatchNet Plus, no ray")
        assert strategy_on_card(paper, card) == (paper, "Priority by PatchNet (paper)")
        ranked_by, said = strategy_on_card(plus, card)
        assert ranked_by is no_ray and said.endswith(": PatchNet Plus is computed on the CPU only")
        live = CardHeat()
        kind = HeatKind(1, 0.5, "viridis", ranked_by)
        until(lambda: live.done, lambda: live.look(card, yard, ("a view",), camera, kind))
        unit = camera_in_unit_cube(camera, yard.octree.grid)
        hits, (decoded, scored, heat) = card.hit_images(unit), (device.image(96, 80, FLOATS) for _ in range(3))
        card.trace(unit, hits)
        card.decode(unit, hits, decoded)
        card.estimate(unit, hits, decoded, scored)
        ramp = np.ones((256, 4), np.float32)
        ramp[:, :3] = colormap(np.linspace(0, 1, 256), "viridis")
        card.heat(unit, hits, scored, device.texture(ramp.view(np.uint32)), (1, 0.5), heat)
        card.estimates = False
        assert strategy_on_card(plus, card)[0] is paper
        pixels = [live.describe_pixel(column, row) for row in range(0, 80, 8) for column in (0, 48, 95)]
        return device.read(live.shown, FLOATS), device.read(heat, FLOATS), pixels

    shown, whole, pixels = with_gpu(work)
    np.testing.assert_array_equal(shown, whole)
    view = drain(trace_view(yard.octree, camera, [no_ray], coded=yard, reference=False))
    scores, hit = view.picture(no_ray.scores(view)), view.picture(view.hit)
    places = [(row, column) for row in range(0, 80, 8) for column in (0, 48, 95)]
    assert any(hit[place] for place in places)
    for place, lines in zip(places, pixels, strict=True):
        assert lines[1] == (f"Priority {scores[place]:.4g}" if hit[place] else "Level none: background")


def until(done: Callable[[], bool], work: Callable[[], object]) -> None:
    """Work until something is there, as drawings of a viewport do."""
    for _ in range(2000):
        if done():
            return
        work()
    raise AssertionError("never there")


def test_octrees_come_to_the_card_step_by_step_and_go_with_their_results(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cards, "preferences", lambda _context: Preferences(viewport=VIEWPORT_CARD))

    def work() -> None:
        assert cards.same_bits()
        octree = random_octree(seed=2, depth=5, count=400)
        coded = drain(encode_octree(octree, load_weights()))
        assert cards.card_of(bpy.context, octree) is None and cards.is_coming(octree)
        until(lambda: cards.is_there(octree), lambda: cards.card_of(bpy.context, octree))
        assert not cards.is_coming(octree) and cards.why_cpu(octree) == ""
        until(lambda: cards.codes_on_card(coded)[0], lambda: None)
        again = replace(coded, codes=coded.codes + 0)
        before = cards._cards()[octree].octree._bound["codes"]
        until(lambda: cards.codes_on_card(again)[0], lambda: None)
        assert cards._cards()[octree].octree._bound["codes"] is not before
        cards.give_up(octree, "it broke")
        assert cards.card_of(bpy.context, octree) is None and cards.why_cpu(octree).endswith(": it broke")

    with_gpu(work)
    gc.collect()
    assert not cards._cards()


def test_what_is_on_its_way_can_be_freed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cards, "preferences", lambda _context: Preferences(viewport=VIEWPORT_CARD))
    octree = random_octree()

    def work() -> None:  # the end of a render frees it, too
        cards.card_of(bpy.context, octree)
        assert cards.is_coming(octree)
        cards.free_coming()
        assert not cards._cards()

    with_gpu(work)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({}, "is no graphics card"),
        ({"viewport": VIEWPORT_CPU}, "chosen in the preferences"),
        ({"viewport": VIEWPORT_CARD, "card_gib": 0.0}, "0 GiB are allowed"),
    ],
)
def test_why_the_processor_draws(values: dict[str, Any], said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Here on a software renderer."""
    monkeypatch.setattr(cards, "preferences", lambda _context: Preferences(**values))
    octree = random_octree()
    with_gpu(lambda: until(lambda: bool(cards.why_cpu(octree)), lambda: cards.card_of(bpy.context, octree)))
    assert said in cards.why_cpu(octree) and not cards.is_there(octree)


def test_a_shader_that_does_not_compile_lets_the_processor_draw(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cards, "preferences", lambda _context: Preferences(viewport=VIEWPORT_CARD))
    monkeypatch.setitem(card_octree.SHADERS, "picture", replace(card_octree.SHADERS["picture"], defines={"vec4": "no"}))
    octree = random_octree()
    with_gpu(lambda: until(lambda: bool(cards.why_cpu(octree)), lambda: cards.card_of(bpy.context, octree)))
    assert "picture_main.glsl does not compile on " in cards.why_cpu(octree)
