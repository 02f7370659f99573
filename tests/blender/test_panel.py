# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab: settings, notes, outdated results, estimates, advice, comparison."""

from pathlib import Path
from types import SimpleNamespace

import bpy

import blf  # isort: skip  (there once bpy is)
import pytest

from patchnet.operators.overlay.panel import _draw_how_to_see
from patchnet.operators.schema.setting import Place
from patchnet.operators.session import results
from patchnet.operators.session.scene_result import Comparison, Row, SceneResult
from patchnet.operators.session.scene_session import session_of
from patchnet.operators.session.staleness import look_again
from patchnet.operators.settings.job_settings import TABLE, recorded
from patchnet.operators.settings.named import named_settings, with_flags
from patchnet.operators.ui import tab
from patchnet.operators.ui.main import PATCHNET_PT_main, PATCHNET_PT_statistics
from patchnet.operators.ui.stages import (
    PATCHNET_PT_compare,
    PATCHNET_PT_network,
    PATCHNET_PT_octree,
    PATCHNET_PT_preview,
    advice,
)
from patchnet.patchnet_addon.runtime.quantities import error_text
from patchnet.patchnet_addon.sampling.registry import FOR_USERS
from patchnet.tests.blender.drawn import Layout, drawn, everything, small_preview
from patchnet.tests.blender.job_scene import principled
from patchnet.tests.blender.scene_snapshot import assert_unchanged, scene_snapshot

pytestmark = pytest.mark.usefixtures("scene")

OPERATORS = {
    "run_all", "estimate", "voxelize", "bake_light", "bake_animation", "precompute_codes", "render_preview", "compare",
    "show_voxels", "export_octree", "clear_results",
}  # fmt: skip


def test_first_panel_has_five_settings(scene: bpy.types.Scene) -> None:
    names = {item.identifier for item in scene.patchnet.bl_rna.properties}

    def shown() -> list[str]:
        return [text for text in drawn(PATCHNET_PT_main) if text in names]

    assert shown() == ["scope", "resolution", "noise_threshold", "use_size_x", "size_x", "use_size_y", "budget"]
    scene.patchnet.resolution, scene.patchnet.light = "DEPTH", "two-lights"
    assert shown() == ["scope", "resolution", "depth", "use_size_x", "size_x", "use_size_y", "budget"]
    first = {row.name for row in TABLE.values() if row.place is Place.FIRST} - {"size", "budget"}
    assert not first & {text for item in (PATCHNET_PT_octree, PATCHNET_PT_preview) for text in drawn(item)}


def test_what_is_automatic_is_said_in_words(scene: bpy.types.Scene) -> None:
    values = scene.patchnet
    assert {"All Free", "use_memory"} <= set(drawn(PATCHNET_PT_octree)) and "memory" not in drawn(PATCHNET_PT_octree)
    assert {"By Budget", "By Strategy"} <= set(drawn(PATCHNET_PT_preview))
    assert "By Aspect" in drawn(PATCHNET_PT_main)
    for name in ("memory", "exposure", "spp", "heatmap_maximum", "size_x", "size_y"):
        setattr(values, f"use_{name}", True)
        assert getattr(values, name) > 0 and getattr(values, f"use_{name}")
        setattr(values, f"use_{name}", False)
        assert getattr(values, name) == 0 and not getattr(values, f"use_{name}")
    values.size_x = 7
    values.use_size_x = True
    assert values.size_x == 7, "a number that is there stays"
    values.size_x = 0
    assert drawn(PATCHNET_PT_main).count("As Render") == 2, "both sides of the picture"


def test_short_list_of_strategies(scene: bpy.types.Scene) -> None:
    values = scene.patchnet
    assert [item.identifier for item in values.bl_rna.properties["short_strategy"].enum_items] == [*FOR_USERS, "other"]
    values.short_strategy = "ss-variance"
    assert values.strategy == "ss-variance"
    values.strategy = "random"
    assert values.short_strategy == "other"
    values.short_strategy = "other"
    assert values.strategy == "random", "as it is chosen in Compare"
    assert "strategy" in drawn(PATCHNET_PT_compare) and "strategy" not in drawn(PATCHNET_PT_preview)


def test_all_panels_draw_in_every_state(scene: bpy.types.Scene) -> None:
    before = everything()
    assert "Nothing computed yet" in before and "Not compared yet" in before
    bpy.ops.patchnet.voxelize(depth=4)
    assert "Depth 4" in everything()
    small_preview()
    snapshot = scene_snapshot()
    text = everything()
    assert_unchanged(snapshot)
    assert {f"patchnet.{name}" for name in OPERATORS} <= set(text.splitlines())
    for light in ("cycles", "two-lights"):
        for resolution in ("AUTO", "DEPTH", "VOXEL_SIZE"):
            for importance in ("NONE", "IMAGE", "VERTEX_GROUP"):
                scene.patchnet.light, scene.patchnet.resolution = light, resolution
                scene.patchnet.importance = importance
                assert ("depth" in everything().splitlines()) == (resolution == "DEPTH")


def test_stale_says_why(scene: bpy.types.Scene) -> None:
    small_preview()
    assert not any(line.endswith(" again") for line in everything().splitlines())
    results.voxels_of(scene).mark("view", "the camera changed")
    assert "The camera changed: render again" in drawn(PATCHNET_PT_preview)
    assert results.voxels_of(scene).stale == set()
    bpy.data.lights["Lamp"].energy = 1.0
    bpy.data.materials["Slab"].diffuse_color = (1, 0, 0, 1)
    for index in range(5):
        bpy.data.objects[f"Lath {index}"].location.x += 0.1
    bpy.context.view_layer.update()
    result = results.voxels_of(scene)
    look_again(result, scene)
    assert result.stale == {"surface", "light"}
    assert "lamp 'Lamp' changed" in result.why("light") and "material 'Slab' changed" in result.why("light")
    assert result.why("surface").count("changed") == 3 and result.why("surface").endswith("and more")
    assert any(line.startswith("'Lath ") and line.endswith("voxelize again") for line in drawn(PATCHNET_PT_octree))


def test_changed_settings_are_named_and_advice_has_buttons(scene: bpy.types.Scene) -> None:
    result = small_preview()
    scene.patchnet.resolution = "DEPTH"
    for share, drawn_too in ((0.4, True), (1.0, False)):
        result.lookahead_share = share
        text = drawn(PATCHNET_PT_preview)
        assert ("wm.context_set_enum" in text and "Voxel Detail: Automatic" in text) == drawn_too
    scene.patchnet.resolution = "VOXEL_SIZE"
    assert "'Voxel Detail' changed: voxelize again" in drawn(PATCHNET_PT_octree)
    scene.patchnet.resolution = "AUTO"
    assert not any("again" in line for line in drawn(PATCHNET_PT_octree))
    scene.patchnet.weights = ""
    assert "'Weights' changed: prepare again" in drawn(PATCHNET_PT_network)
    scene.patchnet.budget = 0.1
    assert "'Pixel Budget' changed: render again" in drawn(PATCHNET_PT_preview)


def test_statistics(scene: bpy.types.Scene) -> None:
    result = small_preview()
    text = "\n".join(drawn(PATCHNET_PT_statistics))
    for part in (
        f"{result.octree.leaf_count:,} voxels", f"{result.octree.node_count:,} nodes", "In memory: ",
        f"Look-ahead on {result.lookahead_share:.1%}", "Voxels", "Look-ahead", "Views",
        "by built-in kernels on the CPU",
        "Error x 10,000: {}, refined {}".format(*map(error_text, result.errors)),
    ):  # fmt: skip
        assert part in text
    assert set(result.seconds) >= {"read", "depth", "light", "voxelize", "codes", "views"}


def test_advice_on_strategies(scene: bpy.types.Scene) -> None:
    """Only for the view that was compared, and only where another one is clearly better."""
    rows = (Row("optimal", "Optimal", 1e-4), Row("ss-variance", "Screen", 8e-4), Row("patchnet", "PatchNet", 1e-3))
    result = SceneResult(
        octree=None, scope="VISIBLE", lookahead_share=1.0, comparison=Comparison("Eye", 0.3, 2e-3, rows)
    )
    values = scene.patchnet
    values.strategy = "patchnet-plus"
    result.made_with["view"] = recorded(values, "view")
    assert advice(result, values) == [], "the chosen one was not compared"
    values.strategy = "patchnet"
    (found,) = advice(result, values)
    assert "Screen leaves 20% less error than PatchNet: choose Strategy: Screen, and render again" in found
    values.strategy = "ss-variance"
    assert advice(result, values) == [], "an oracle is no choice"
    values.strategy, values.budget = "patchnet", 0.1
    assert advice(result, values) == [], "another budget"
    values.budget = 0.3
    result.mark("view", "camera 'Eye' moved")
    assert advice(result, values) == []


def test_advice_on_look_ahead(scene: bpy.types.Scene) -> None:
    result = SceneResult(octree=None, scope="VISIBLE", lookahead_share=0.4)
    values = scene.patchnet
    for resolution, todo in (("DEPTH", {"AUTO"}), ("VOXEL_SIZE", {"AUTO"}), ("AUTO", set())):
        values.resolution = resolution
        (found,) = advice(result, values)
        assert found.startswith("Voxels are too coarse to look ahead on 60% of this picture: ")
        assert {(row.name, value) for row, value in named_settings(found).values()} == {
            ("resolution", value) for value in todo
        }
    result.lookahead_share = 0.95
    assert advice(result, values) == []


def test_texts_have_lines_as_wide_as_the_region() -> None:
    text = "Materials 'Glass', 'Bottle' are see-through, without reflections and refraction: use Refine with Cycles"
    for width, scale in ((280, 1.0), (292, 1.0), (640, 2.0)):
        layout, region = Layout(), SimpleNamespace(width=width)
        system = SimpleNamespace(ui_scale=scale)
        context = SimpleNamespace(region=region, preferences=SimpleNamespace(system=system))
        tab.draw_sentence(layout, context, text, "INFO")
        lines = [line for line in layout.texts if line not in ("INFO", "BLANK1")]
        assert " ".join(lines) == text and len(lines) > 2
        blf.size(0, 11.0 * scale)
        assert all(blf.dimensions(0, line)[0] < width - 60 * scale for line in lines)


def with_notes(scene: bpy.types.Scene) -> None:
    """Glass, a mirror, a curtain that is half transparent, a mist, and objects that are no surface."""
    for index, (name, values) in enumerate(
        {
            "Glass": {"Transmission Weight": 1.0, "Roughness": 0.0},
            "Mirror": {"Metallic": 1.0, "Roughness": 0.0},
            "Curtain": {"Alpha": 0.5},
        }.items()
    ):
        for key, value in values.items():
            principled(f"Lath {index}").inputs[key].default_value = value
        bpy.data.materials[f"Lath {index}"].name = name
    tree = bpy.data.materials["Lath 3"].node_tree
    mist = tree.nodes.new("ShaderNodeVolumePrincipled").outputs[0]
    tree.links.new(mist, tree.nodes["Material Output"].inputs["Volume"])
    bpy.data.materials["Lath 3"].name = "Mist"
    scene.collection.objects.link(bpy.data.objects.new("Smoke", bpy.data.volumes.new("Smoke")))
    scene.camera.data.dof.use_dof = True
    bpy.context.view_layer.update()


def test_what_is_left_out_is_said_in_the_panel(scene: bpy.types.Scene) -> None:
    """Beside the estimate before the job and below its button after it, without flags, with buttons, until the next."""
    with_notes(scene)
    values = {"scope": "VISIBLE", "depth": 4, "size": (24, 16)}
    bpy.ops.patchnet.estimate(**values)
    known = session_of(scene).estimate.notes
    for name in ("'Eye'", "'Glass'", "'Mirror'", "'Curtain'", "'Mist'", "'Smoke'"):
        assert any(name in text for text in known), name
    scene.patchnet.gloss = "off"
    bpy.ops.patchnet.run_all(max_samples=2, light="cycles", **values)
    result = results.voxels_of(scene)
    assert set(known) - set(result.all_notes) == {text for text in known if "reflections" in text}
    text = drawn(PATCHNET_PT_main)
    assert "Gloss: Automatic" in text and "patchnet.refine_with_cycles" in text
    assert not any("--" in line for line in text)
    scene.patchnet.gloss = "auto"
    assert "Gloss: Automatic" not in drawn(PATCHNET_PT_main), "it is chosen already"
    assert any("black: choose Gloss: Automatic" in note for note in result.all_notes)
    result.notes = {"octree": tuple(f"Note {number}" for number in range(8))}
    text = drawn(PATCHNET_PT_main)
    assert {"8 Notes", "Note 0", "Note 4", "and 3 more in the Info log"} <= set(text) and "Note 5" not in text
    bpy.ops.patchnet.voxelize(depth=4, scope="SELECTED")
    assert results.voxels_of(scene).all_notes == []


def test_commands_add_flags_to_sentences_of_a_window() -> None:
    said = with_flags("Choose Gloss: From Camera, bake with Voxel Sides: One, or Denoise: Off (Network Device)")
    assert said == (
        "Choose Gloss: From Camera (--gloss camera), bake with Voxel Sides: One (--sides one), or Denoise: Off "
        "(--no-denoise) (Network Device, --device)"
    )
    assert list(named_settings("choose Strategy: PatchNet Plus, one ray")) == ["Strategy: PatchNet Plus, one ray"]


def test_the_overlay_says_how_to_see_it(scene: bpy.types.Scene) -> None:
    """Through the camera of the picture, which a button looks through."""
    session_of(scene).views["Eye"] = None
    region = SimpleNamespace(view_perspective="PERSP")
    context = SimpleNamespace(scene=scene, region=None, preferences=bpy.context.preferences)
    context.space_data = SimpleNamespace(camera=None, use_local_camera=False, region_3d=region)

    def said() -> list[str]:
        layout = Layout()
        _draw_how_to_see(layout, context)
        return [text for text in layout.texts if text not in ("INFO", "VIEW_CAMERA")]

    assert said() == ["Look through camera 'Eye' to see it (Numpad 0)", "view3d.view_camera", "View Camera"]
    region.view_perspective = "CAMERA"
    assert said() == []
    scene.camera = None
    assert said() == ["Pictures are of 'Eye': make it the active camera"]


def test_pictures_have_buttons_and_are_saved_with_the_file(scene: bpy.types.Scene, tmp_path: Path) -> None:
    """All of them, whether an editor shows them or not."""
    small_preview(reference=False)
    names = {image.name for image in bpy.data.images if "patchnet_result" in image}
    text = drawn(PATCHNET_PT_main)
    assert {"Preview", "Predicted", "Heatmap", "Refined"} <= set(text)
    assert not {"Priority", "Reference"} & set(text)
    assert bpy.ops.patchnet.show_picture(image="PatchNet Eye heatmap") == {"FINISHED"}
    with pytest.raises(RuntimeError, match="no picture 'PatchNet Eye gone' any more"):
        bpy.ops.patchnet.show_picture(image="PatchNet Eye gone")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    assert {image.name for image in bpy.data.images if "patchnet_result" in image} == names
    assert "Heatmap" in drawn(PATCHNET_PT_main)


def test_device(scene: bpy.types.Scene) -> None:
    from patchnet.operators.scene_access.devices import gpu_is_enabled

    if gpu_is_enabled(bpy.context):
        pytest.skip("a GPU is enabled here")
    with pytest.raises(RuntimeError, match=r"no GPU to bake on: enable one in the preferences"):
        bpy.ops.patchnet.run_all(depth=4, size=(16, 16), device="GPU")
    bpy.ops.patchnet.estimate(depth=4, size=(16, 16), device="CPU")
    assert "Bake on: CPU" in session_of(scene).estimate.lines
    with pytest.raises(RuntimeError, match=r"needs an NVIDIA GPU, and PyTorch .* finds none|needs PyTorch"):
        bpy.ops.patchnet.run_all(light="two-lights", depth=4, size=(16, 16), network_device="GPU")
