# SPDX-License-Identifier: GPL-3.0-or-later
"""Gloss of metals, mirrors and glass in baked light, and its warnings."""

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from patchnet import commands
from patchnet.operators.cycles.bake.gloss_passes import gloss_warnings, seen_through, with_view
from patchnet.operators.demo_scene import build_glossy_room
from patchnet.operators.scene.images import ImageReader
from patchnet.operators.scene.materials import read_material
from patchnet.operators.settings.groups import LightSettings
from patchnet.patchnet_addon.image.comparison import picture_psnr
from patchnet.patchnet_addon.image.cycles_passes import baked_light, baked_light_with_gloss
from patchnet.patchnet_addon.octree.file import load_octree
from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.tracing.supersample import supersample
from patchnet.tests.blender.job_scene import saved
from patchnet.tests.blender.light_scene import ALL_PATHS, checked, finished, job_on, lit
from patchnet.tests.blender.objects import SQUARE, cuboid, link, look_from, mesh, new_camera, read
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot
from patchnet.tests.blender.shaders import material, shader, shown, simple, world
from patchnet.tests.blender.shaders import mixed as blended

pytestmark = pytest.mark.usefixtures("empty_scene")
SKY = np.array([0.2, 0.4, 0.8])
WORLD = float(SKY @ (0.2126, 0.7152, 0.0722))


def principled(name: str, **inputs: object) -> bpy.types.Material:
    return simple("BsdfPrincipled", name, **inputs)


def mixed(name: str, share: float, **first: object) -> bpy.types.Material:
    """So much diffuse in a metal."""
    made, tree = material(name)
    shown(tree, blended(tree, shader(tree, "BsdfGlossy", **first), shader(tree, "BsdfDiffuse"), share))
    return made


def sky() -> None:
    """The same light from everywhere, so that a perfect mirror shows it whatever looks at it."""
    world().nodes["Background"].inputs["Color"].default_value = (*SKY, 1.0)


def baked(**values: object) -> tuple[dict[str, float], tuple[str, ...]]:
    """Mean luminance of the front of each object, and warnings."""
    light = LightSettings(**{"cells": "everywhere", "noise_threshold": ALL_PATHS, **values})
    light = with_view(bpy.context.scene, light, ())
    source = seen_through(read(), light.gloss)
    found = finished(job_on(source, light, depth=6))
    fragments = found.fragments
    names = dict.fromkeys(source.object_names, 0.0)
    return names | {name: fragments.of(name).mean_sides[0] for name in set(fragments.names)}, found.light.warnings


def plates() -> None:
    """Plates side by side, each of a material of its own, under the sky."""
    kinds = {
        "Gold": principled("Gold", Metallic=1.0, Base_Color=(1, 1, 1, 1), Roughness=0.4),
        "Mirror": principled("Mirror", Metallic=1.0, Base_Color=(1, 1, 1, 1), Roughness=0.0),
        "Grey": principled("Grey", Base_Color=(0.5, 0.5, 0.5, 1), Specular_IOR_Level=0.5),
        "Glass": principled("Glass", Transmission_Weight=1.0, Base_Color=(1, 1, 1, 1), Roughness=0.0),
    }
    for index, (name, kind) in enumerate(kinds.items()):
        link(mesh(name, SQUARE, [(0, 1, 2, 3)], kind), (3.0 * index, 0.0, 0.0))
    sky()


def test_kinds_of_gloss() -> None:
    images = ImageReader()
    gold = read_material(principled("Gold", Metallic=1.0, Roughness=0.5), images).gloss
    assert gold.is_glossy and not gold.is_clear and not gold.is_sharp
    assert read_material(principled("Chrome", Metallic=1.0, Roughness=0.05), images).gloss.is_sharp
    assert not read_material(principled("Clay", Roughness=0.5), images).gloss.is_glossy
    lamp = {"Metallic": 1.0, "Emission_Color": (1, 1, 1, 1), "Emission_Strength": 3.0}
    assert not read_material(principled("Lamp", **lamp), images).gloss.is_glossy
    glass = read_material(
        principled("Glass", Transmission_Weight=1.0, Roughness=0.0, Base_Color=(1, 1, 1, 1)), images
    ).gloss
    assert glass.is_clear and glass.is_glossy
    tinted = principled("Tinted", Transmission_Weight=1.0, Roughness=0.0, Base_Color=(0.2, 0.2, 0.2, 1))
    frosted = principled("Frosted", Transmission_Weight=1.0, Roughness=0.6, Base_Color=(1, 1, 1, 1))
    for kind in (tinted, frosted):
        assert read_material(kind, images).gloss.is_glossy and not read_material(kind, images).gloss.is_clear
    assert read_material(mixed("Mostly metal", 0.2), images).gloss.is_glossy
    assert not read_material(mixed("Mostly clay", 0.8), images).gloss.is_glossy
    piano = principled("Piano", Base_Color=(0.005, 0.005, 0.005, 1.0), Specular_IOR_Level=0.5)
    assert read_material(piano, images).gloss.is_glossy, "what is black shows gloss alone"


def test_metals_show_the_sky_and_what_is_not_shown_is_named() -> None:
    plates()
    bpy.context.view_layer.update()
    before = scene_snapshot()
    found, warnings = baked(max_samples=32)
    assert_unchanged(before)
    assert found["Mirror"] == pytest.approx(WORLD, rel=0.02)
    assert found["Gold"] == pytest.approx(WORLD, rel=0.2)
    assert found["Glass"] == 0.0, "it is not baked, since it is see-through"
    text = " ".join(warnings)
    assert "'Mirror'" in text and "'Glass' is see-through" in text and "'Gold'" not in text and "'Grey'" not in text
    off, warnings = baked(max_samples=32, gloss="off")
    assert off["Mirror"] == off["Gold"] == 0.0
    assert off["Grey"] == pytest.approx(found["Grey"], rel=0.02), "what has a diffuse part is baked as before"
    assert any("'Gold', 'Mirror'" in warning and "black: choose Gloss" in warning for warning in warnings)
    above, _ = baked(max_samples=32, gloss="above")
    assert above["Grey"] > 1.02 * off["Grey"], "gloss of all materials"


def test_a_camera_sees_other_reflections_than_what_is_above() -> None:
    """A mirror below half a bright sky: its camera sees the bright half, the view from above sees none of it."""
    link(mesh("Mirror", SQUARE, [(0, 1, 2, 3)], principled("Mirror", Metallic=1.0, Roughness=0.0)))
    lamp = simple("Emission", "Lamp", Strength=2.0)
    link(mesh("Wall", [(x, 3.0, z) for x, z in ((-9, 0), (9, 0), (9, 9), (-9, 9))], [(0, 1, 2, 3)], lamp))
    eye = new_camera("Eye", (0.0, -6.0, 2.0))
    with pytest.raises(SceneError, match="no active camera"):
        with_view(bpy.context.scene, LightSettings(gloss="camera"), ())
    above, _ = baked(max_samples=4)
    bpy.context.scene.camera = eye
    seen, warnings = baked(max_samples=4)
    assert above["Mirror"] < 0.01 and seen["Mirror"] == pytest.approx(1.6, rel=0.1)
    assert any("as the active camera sees" in warning for warning in warnings)
    assert not with_view(bpy.context.scene, LightSettings(), ("Eye", "Other")).from_camera, "others look, too"
    assert with_view(bpy.context.scene, LightSettings(), ("Eye",)).from_camera
    assert not with_view(bpy.context.scene, LightSettings(), ("Eye",), track=True).from_camera, (
        "it looks from other places, too"
    )


def test_glass_is_see_through_unless_it_is_all_there_is() -> None:
    glass = principled("Glass", Transmission_Weight=1.0, Roughness=0.0, Base_Color=(1, 1, 1, 1))
    cuboid("Cube", (-1.0,) * 3, (1.0,) * 3, glass)
    alone = read()
    assert seen_through(alone, "auto") is alone
    link(mesh("Floor", SQUARE, [(0, 1, 2, 3)], principled("Clay")))
    both = read()
    alphas = {item.name: item.alpha for item in seen_through(both, "auto").materials}
    assert alphas == {"Glass": 0.0, "Clay": 1.0}
    assert seen_through(both, "off") is both
    assert gloss_warnings(replace(both, gloss=()), LightSettings()) == ()


def test_regions_by_cycles_show_metals_as_the_voxels_do() -> None:
    """Where there is no diffuse colour, all light: the other pixel has gloss, too, and shows its diffuse light."""
    values = {"Combined": (0.9, 0.7), "DiffDir": (0, 0.5), "DiffInd": (0, 0.5), "DiffCol": (0, 0.4), "Emit": (0, 0)}
    channels = {f"ViewLayer.{name}.{c}": np.array([two], np.float32) for name, two in values.items() for c in "RGB"}
    np.testing.assert_allclose(baked_light(channels)[0, :, 0], [0.0, 0.4])
    np.testing.assert_allclose(baked_light_with_gloss(channels)[0, :, 0], [0.9, 0.4])


def test_a_room_of_metal_and_glass_is_what_cycles_renders() -> None:
    """Against all light of a render: 22 dB with gloss, though at a coarse depth, and less without it."""
    bpy.ops.wm.read_homefile(use_empty=True)
    build_glossy_room(bpy.context.scene)
    settings = {"depth": 7, "size": (40, 40), "max_samples": 8}
    check = checked(render_samples=128, **settings)
    assert check.report["light"]["gloss"] == "auto" and check.report["cameras"][0]["psnr_db"] >= 22.0
    off = lit(**settings, gloss="off").octree
    assert off.provenance["gloss"] == "off"
    seen = check.cameras[0]
    without = drain(supersample(off, seen.camera, 8)).luminance.reshape(seen.cycles.shape)
    without *= check.octree.exposure / off.exposure
    assert picture_psnr(np.clip(without, 0.0, 1.0), seen.cycles) < 18.5


def test_command_of_octrees_bakes_for_any_camera(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its file is looked at from anywhere, so automatic gloss is seen from above; what is wanted is done."""
    plates()
    look_from((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    scene = saved(tmp_path / "plates.blend")
    for gloss, noise, said in (("auto", [], "above the surface"), ("camera", ["--no-denoise"], "active camera sees")):
        out = tmp_path / f"{gloss}.safetensors"
        words = ["--depth", "4", "--max-samples", "2", "--gloss", gloss, *noise]
        assert commands.main(["octree", str(scene), *words, "--out", str(out)]) == 0
        assert said in capsys.readouterr().err
        light = load_octree(out).provenance
        assert (light["gloss"], light["denoise"]) == (gloss, not noise)
