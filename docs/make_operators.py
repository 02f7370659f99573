# SPDX-License-Identifier: GPL-3.0-or-later
"""Make operators.md from the operators registered in Blender.

    python docs/make_operators.py

Names, descriptions, properties, defaults, and the answers in a scene without results are read from Blender. NOTES has
the results of each operator and a line to try it; the script fails for an operator without notes, and
tests/blender/test_docs.py runs the lines.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy  # noqa: TID251

import patchnet
from patchnet.__main__ import leave
from patchnet.operators.jobs.job_operator import JobOperator
from patchnet.operators.properties.stages import AnimationProperties, DisplayProperties, LevelProperties
from patchnet.operators.schema import values as stages
from patchnet.operators.settings.job_settings import rows

PAGE = Path(__file__).with_name("operators.md")
# Settings of a scene, by stages of the table or by the class that declares them.
GROUPS = {
    "Octree: what is voxelized, and how finely": rows(stages.OCTREE),
    "Light: where luminance comes from": rows(stages.LIGHT),
    "Network that looks ahead": rows(stages.CODES),
    "Cameras: whose pictures are made, and how large": rows(stages.CAMERAS),
    "View: what is refined first, what matters to the user, and how it is shown": rows(stages.VIEW, stages.IMPORTANCE),
    "Output: where files go": rows(stages.OUTPUT),
    "Animation: how its frames are baked": AnimationProperties,
    "Level that is shown or exported": LevelProperties,
    "Voxels in the scene. Operators forget these values, so that those of the panel count for each call": (
        DisplayProperties
    ),
    "Refinement of a preview with Cycles": rows(stages.REFINEMENT),
    "Renders of the engine": rows(stages.RENDERS),
}


@dataclass(frozen=True)
class Note:
    """Notes on an operator. leaves: its results. line: Python to try it, "" for operators that need a mouse."""

    leaves: str
    line: str = ""


_VIEW = (
    "images whose names begin with `PatchNet`: preview, predicted, heatmap, overlay, refined, reference and error as "
    "pictures, and raw values of the pixels as floats,"
)
NOTES = {
    "run_all": Note(
        f"{_VIEW} of each camera; octree and codes in memory; with an output folder, "
        "[its files](command-line.md#output-files)",
        "bpy.ops.patchnet.run_all(depth=6, max_samples=2, out='//out')",
    ),
    "estimate": Note("nothing in the scene; the panel shows the estimate", "bpy.ops.patchnet.estimate(depth=6)"),
    "voxelize": Note(
        "nothing in the scene; the octree in memory, in the surface's own color",
        "bpy.ops.patchnet.voxelize(depth=6)",
    ),
    "bake_light": Note(
        "nothing in the scene; the lit octree in memory",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.bake_light(max_samples=2)",
    ),
    "precompute_codes": Note(
        "nothing in the scene; the codes in memory",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.bake_light(max_samples=2); "
        "bpy.ops.patchnet.precompute_codes()",
    ),
    "render_preview": Note(
        f"{_VIEW} of the first camera",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.bake_light(max_samples=2); "
        "bpy.ops.patchnet.precompute_codes(); bpy.ops.patchnet.render_preview(budget=0.5)",
    ),
    "compare": Note(
        f"{_VIEW} of the first camera; the panel Compare shows the table",
        "bpy.ops.patchnet.run_all(depth=6, max_samples=2); bpy.ops.patchnet.compare(strategy='ss-variance')",
    ),
    "refine_with_cycles": Note(
        "images of the first camera: the preview with Cycles' pixels over it, and a mask of these pixels",
        "bpy.ops.patchnet.run_all(depth=6, max_samples=2); "
        "bpy.ops.patchnet.refine_with_cycles(cycles_budget=0.1, cycles_samples=4)",
    ),
    "bake_animation": Note(
        "nothing in the scene, which keeps its frame; a folder per frame and `report.json` in the output folder",
        "bpy.ops.patchnet.bake_animation(frame_start=1, frame_end=2, depth=6, max_samples=2, out='//out')",
    ),
    "fly_through": Note(
        "nothing in the scene but All Frames; the pictures of the scene's frames that were not there",
        "bpy.ops.patchnet.fly_through(frame_start=1, frame_end=2)",
    ),
    "show_voxels": Note(
        "the object `PatchNet Voxels` with its mesh, geometry nodes and material; the next call fills the same object",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.show_voxels(level=5)",
    ),
    "export_octree": Note(
        "nothing in the scene; the file",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.export_octree(filepath='//voxels.ply', level=5)",
    ),
    "load_octree": Note(
        "nothing in the scene; the octree in memory, and its codes if `codes.safetensors` is beside it",
        "bpy.ops.patchnet.run_all(depth=6, max_samples=2, out='//out'); bpy.ops.patchnet.clear_results(); "
        "bpy.ops.patchnet.load_octree(filepath='//out/octree.safetensors')",
    ),
    "clear_results": Note(
        "images, the object `PatchNet Voxels` and files; octree and codes are freed",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.clear_results()",
    ),
    "add_demo_scene": Note(
        "a scene `PatchNet Courtyard` with objects, materials and images of its own, which the window then shows",
        "bpy.ops.patchnet.add_demo_scene()",
    ),
    "show_picture": Note("nothing in the scene; the picture in an Image Editor or a new window"),
    "inspect_pixels": Note("nothing"),
    "clear_cache": Note(
        "nothing in the scene; the cache folder without compiled kernels, light of bakes and octrees",
        "bpy.ops.patchnet.clear_cache()",
    ),
    "copy_diagnostics": Note("text on the clipboard", "bpy.ops.patchnet.copy_diagnostics()"),
}
# Screenshot of the panel with the button, at the panel's first operator.
PICTURES = {
    "run_all": "panel-main.png",
    "voxelize": "panel-octree.png",
    "bake_light": "panel-light.png",
    "precompute_codes": "panel-network.png",
    "render_preview": "panel-preview.png",
    "compare": "panel-compare.png",
    "refine_with_cycles": "panel-cycles-refine.png",
    "show_voxels": "panel-export.png",
    "clear_results": "panel-statistics.png",
    "inspect_pixels": "panel-overlay.png",
    "clear_cache": "preferences.jpg",
}


def operators() -> dict[str, type]:
    """Public operators by name, in the order of the notes."""
    found = {
        name.removeprefix("PATCHNET_OT_").lower(): getattr(bpy.types, name)
        for name in dir(bpy.types)
        if name.startswith("PATCHNET_OT_") and "INTERNAL" not in getattr(bpy.types, name).bl_options
    }
    if missing := sorted(set(found) - set(NOTES)):
        raise SystemExit(f"{__file__}: NOTES lacks {', '.join(missing)}")
    return {name: found[name] for name in NOTES if name in found}


def refusal(name: str) -> str:
    """Message of the operator's poll in the open scene, "" if the operator can run."""
    if getattr(bpy.ops.patchnet, name).poll():
        return ""
    try:
        getattr(bpy.ops.patchnet, name)()
    except RuntimeError as error:
        return str(error).strip().splitlines()[-1].partition(".poll() ")[2] or str(error)
    raise AssertionError(f"{name} ran where its poll refused")


def shown(item: Any) -> str:
    """A property's default as Python writes it."""
    value = list(item.default_array) if getattr(item, "is_array", False) else item.default
    if item.type == "FLOAT":
        value = round(value, 6)
    return f"`{tuple(value) if isinstance(value, list) else value!r}`"


def limits(item: Any) -> str:
    """Allowed values of a property."""
    if item.type == "ENUM":
        return "<br>".join(f"`{each.identifier!r}` {each.name}: {each.description}" for each in item.enum_items)
    if item.type in ("INT", "FLOAT"):
        upper = f" to {_number(item.hard_max)}" if item.hard_max < 2**31 - 1 else " and more"
        return f"{_number(item.hard_min)}{upper}"
    return {"BOOLEAN": "`True`, `False`", "STRING": "text"}[item.type]


def _number(value: float) -> str:
    return f"{int(value):,}" if value == int(value) else f"{value:g}"


def table(items: list[Any]) -> Iterator[str]:
    """Table of properties."""
    yield "| property | default | values | what it is |"
    yield "|---|---|---|---|"
    for item in items:
        yield f"| `{item.identifier}`, {item.name} | {shown(item)} | {limits(item)} | {item.description} |"


def own_properties(name: str) -> list[Any]:
    """Properties of an operator that users can set."""
    values = getattr(bpy.ops.patchnet, name).get_rna_type().properties
    return [item for item in values if item.identifier != "rna_type" and not item.is_hidden]


def wrapped(text: str, indent: str = "") -> list[str]:
    """Lines of up to 120 characters; all but the first have `indent`."""
    return textwrap.wrap(text, 120, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def item_of(text: str) -> list[str]:
    """An item of a list."""
    return wrapped(f"- {text}", "  ")


def section(name: str, kind: type) -> Iterator[str]:
    """Section of an operator."""
    rna, note = getattr(bpy.ops.patchnet, name).get_rna_type(), NOTES[name]
    scene = bpy.types.Scene.bl_rna.properties["patchnet"].fixed_type.properties
    yield f"## {rna.name}: `patchnet.{name}`"
    yield ""
    yield from wrapped(f"{' '.join(rna.description.split())}.")
    yield ""
    if name in PICTURES:
        yield f'<img src="pictures/{PICTURES[name]}" alt="Panel with {rna.name}">'
        yield ""
    said = refusal(name)
    answer = f"refused: {said}" if said else "runs"
    yield from item_of(f"In a scene without results: {answer}.")
    if issubclass(kind, JobOperator):
        yield "- A job: in a window it shows progress and Esc stops it; from scripts it runs to its end; one at a time."
    yield from item_of(f"Leaves {note.leaves}.")
    yield from item_of(
        f"Undo: {'a step' if 'UNDO' in kind.bl_options else 'no step, since no data of the scene changes'}."
    )
    items = own_properties(name)
    shared = [item.identifier for item in items if item.identifier in scene]
    if shared:
        yield from item_of(
            f"Arguments that default to the scene's settings: {', '.join(f'`{each}`' for each in shared)}."
        )
    yield ""
    if note.line:
        yield "```sh"  # indentation would make it part of the list above
        yield f'blender -b scene.blend --python-exit-code 1 --python-expr "import bpy; {note.line}"'
        yield "```"
        yield ""
    if own := [item for item in items if item.identifier not in scene]:
        yield from table(own)
        yield ""


def settings() -> Iterator[str]:
    """The scene's settings by group."""
    scene = bpy.types.Scene.bl_rna.properties["patchnet"].fixed_type.properties
    for title, group in GROUPS.items():
        names = [row.name for row in group] if isinstance(group, list) else list(group.__annotations__)
        yield f"### {title}"
        yield ""
        yield from table([scene[name] for name in names])
        yield ""


HEAD = """\
# Operators

With this page you can call every operator from a script, and look up every setting. It is made by
`docs/make_operators.py` from the operators themselves: change them there, then run it.

Call an operator as `bpy.ops.patchnet.NAME(...)`. An omitted argument has the value of the scene's setting
`scene.patchnet.NAME`, which the panel shows; the last section lists all settings. `depth` or `voxel_size` needs no
`resolution`. An error is a sentence in Blender's status bar, and a `RuntimeError` in a script; the scene is unchanged,
and finished parts are kept for the next call. Octree and codes stay in memory until another file is opened or Free
Memory is pressed; the .blend file does not store them.

Try the lines on a saved scene with a camera; they are small (`depth=6`, one sample) and finish soon. In background,
`scope` is all visible objects by default, in a window the selected ones.
"""


def page() -> str:
    """The whole page. Opens an empty file, in which the operators' polls are called."""
    bpy.ops.wm.read_homefile(use_empty=True)
    lines = [HEAD]
    for name, kind in operators().items():
        lines += section(name, kind)
    lines += ["## Settings", ""]
    lines += settings()
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Write operators.md beside this file."""
    patchnet.register()
    PAGE.write_text(page(), encoding="utf-8")
    patchnet.unregister()
    leave(0)


if __name__ == "__main__":
    main()
