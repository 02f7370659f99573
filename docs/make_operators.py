# SPDX-License-Identifier: GPL-3.0-or-later
"""Make operators.md from the operators as Blender knows them.

    python docs/make_operators.py

Names, descriptions, properties and defaults are read from Blender, and so is what a click says in a scene without
results. What an operator needs and leaves, and a line to try it with, stand in NOTES: an operator that is not there
stops this script, and tests/blender/test_docs.py tries the lines.
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
from patchnet.operators.properties import PatchNetSettings
from patchnet.operators.properties.scene import DerivedProperties

PAGE = Path(__file__).with_name("operators.md")


@dataclass(frozen=True)
class Note:
    """Notes on an operator that Blender does not know. line: Python to try it with, "" where a mouse is needed."""

    leaves: str
    line: str = ""


_VIEW = (
    "images that begin with `PatchNet`: preview, predicted, heatmap, overlay, refined, reference and error as "
    "pictures, and raw values of the pixels as floats,"
)
NOTES = {
    "run_all": Note(
        f"{_VIEW} of each camera; octree and codes in memory; the files that "
        "[command-line.md](command-line.md#output-files) lists where an output folder is "
        "given",
        "bpy.ops.patchnet.run_all(depth=6, samples=1, out='//out')",
    ),
    "estimate": Note("nothing in the scene; the panel shows the estimate", "bpy.ops.patchnet.estimate(depth=6)"),
    "voxelize": Note(
        "nothing in the scene; the octree in memory, in the surface's own color",
        "bpy.ops.patchnet.voxelize(depth=6)",
    ),
    "bake_light": Note(
        "nothing in the scene; the lit octree in memory",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.bake_light(samples=1)",
    ),
    "precompute_codes": Note(
        "nothing in the scene; the codes in memory",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.bake_light(samples=1); "
        "bpy.ops.patchnet.precompute_codes()",
    ),
    "render_preview": Note(
        f"{_VIEW} of the first camera",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.bake_light(samples=1); "
        "bpy.ops.patchnet.precompute_codes(); bpy.ops.patchnet.render_preview(budget=0.5)",
    ),
    "compare": Note(
        f"{_VIEW} of the first camera; the panel Compare shows the table",
        "bpy.ops.patchnet.run_all(depth=6, samples=1); bpy.ops.patchnet.compare(strategy='ss-variance')",
    ),
    "refine_with_cycles": Note(
        "images of the first camera: the preview with Cycles' pixels over it, and where they are",
        "bpy.ops.patchnet.run_all(depth=6, samples=1); "
        "bpy.ops.patchnet.refine_with_cycles(cycles_budget=0.1, cycles_samples=4)",
    ),
    "bake_animation": Note(
        "nothing in the scene, whose frame is as before; a folder per frame and `report.json` in the output folder",
        "bpy.ops.patchnet.bake_animation(frame_start=1, frame_end=2, depth=6, samples=1, out='//out')",
    ),
    "show_voxels": Note(
        "the object `PatchNet Voxels` with its mesh, geometry nodes and material; the next call fills the same object",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.show_voxels(level=5, display='POINTS')",
    ),
    "export_octree": Note(
        "nothing in the scene; the file",
        "bpy.ops.patchnet.voxelize(depth=6); bpy.ops.patchnet.export_octree(filepath='//voxels.ply', level=5)",
    ),
    "load_octree": Note(
        "nothing in the scene; the octree in memory, and its codes where `codes.safetensors` lies beside it",
        "bpy.ops.patchnet.run_all(depth=6, samples=1, out='//out'); bpy.ops.patchnet.clear_results(); "
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
    "toggle_overlay": Note("nothing: the overlay is a setting of the window, and is not saved"),
    "drag_wipe": Note("nothing: the line's position is a setting of the window, and is not saved"),
    "inspect_pixels": Note("nothing"),
    "clear_cache": Note(
        "nothing in the scene; the cache folder without compiled kernels, light of bakes and octrees",
        "bpy.ops.patchnet.clear_cache()",
    ),
    "copy_diagnostics": Note("text on the clipboard", "bpy.ops.patchnet.copy_diagnostics()"),
}
# Of the panel with the button, at the first operator of each.
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
    "toggle_overlay": "panel-overlay.png",
    "clear_cache": "preferences.jpg",
}


def operators() -> dict[str, type]:
    """Public operators by name, those with notes first and in their order."""
    found = {
        name.removeprefix("PATCHNET_OT_").lower(): getattr(bpy.types, name)
        for name in dir(bpy.types)
        if name.startswith("PATCHNET_OT_") and "INTERNAL" not in getattr(bpy.types, name).bl_options
    }
    if missing := sorted(set(found) - set(NOTES)):
        raise SystemExit(f"{__file__}: NOTES lacks {', '.join(missing)}")
    return {name: found[name] for name in NOTES if name in found}


def refusal(name: str) -> str:
    """Ask the operator's poll in the open scene; its message, "" if it agrees."""
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
    """Values that a property takes."""
    if item.type == "ENUM":
        return "<br>".join(f"`{each.identifier!r}` {each.name}: {each.description}" for each in item.enum_items)
    if item.type in ("INT", "FLOAT"):
        upper = f" to {_number(item.hard_max)}" if item.hard_max < 2**31 - 1 else " and more"
        return f"{_number(item.hard_min)}{upper}"
    return {"BOOLEAN": "`True`, `False`", "STRING": "text"}[item.type]


def _number(value: float) -> str:
    return f"{int(value):,}" if value == int(value) else f"{value:g}"


def table(items: list[Any]) -> Iterator[str]:
    """Properties, a row each."""
    yield "| property | default | values | what it is |"
    yield "|---|---|---|---|"
    for item in items:
        yield f"| `{item.identifier}`, {item.name} | {shown(item)} | {limits(item)} | {item.description} |"


def own_properties(name: str) -> list[Any]:
    """Settings that a user can give to an operator."""
    values = getattr(bpy.ops.patchnet, name).get_rna_type().properties
    return [item for item in values if item.identifier != "rna_type" and not item.is_hidden]


def wrapped(text: str, indent: str = "") -> list[str]:
    """Lines of 120 characters; `indent` of all but the first."""
    return textwrap.wrap(text, 120, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def item_of(text: str) -> list[str]:
    """An item of a list."""
    return wrapped(f"- {text}", "  ")


def section(name: str, kind: type) -> Iterator[str]:
    """An operator."""
    rna, note = getattr(bpy.ops.patchnet, name).get_rna_type(), NOTES[name]
    scene = bpy.types.Scene.bl_rna.properties["patchnet"].fixed_type.properties
    yield f"## {rna.name}: `patchnet.{name}`"
    yield ""
    yield from wrapped(f"{' '.join(rna.description.split())}.")
    yield ""
    if name in PICTURES:
        yield f'<img src="pictures/{PICTURES[name]}" alt="Where {rna.name} is">'
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
            f"Takes from the scene's settings what is not given: {', '.join(f'`{each}`' for each in shared)}."
        )
    yield ""
    if note.line:
        yield "```sh"  # not indented, which would make it part of the list above
        yield f'blender -b scene.blend --python-exit-code 1 --python-expr "import bpy; {note.line}"'
        yield "```"
        yield ""
    if own := [item for item in items if item.identifier not in scene]:
        yield from table(own)
        yield ""


def groups(kind: type) -> Iterator[type]:
    """A class after those it is made of."""
    for base in kind.__bases__:
        yield from groups(base)
    yield kind


def settings() -> Iterator[str]:
    """The scene's settings, by the group they are declared in."""
    scene = bpy.types.Scene.bl_rna.properties["patchnet"].fixed_type.properties
    seen: set[str] = set()
    for group in groups(PatchNetSettings):
        names = [name for name in getattr(group, "__annotations__", {}) if name in scene and name not in seen]
        seen |= set(names)
        if names and group is not DerivedProperties:  # which are of the panel alone
            yield f"### {(group.__doc__ or '').strip().splitlines()[0].rstrip('.')}"
            yield ""
            yield from table([scene[name] for name in names])
            yield ""


HEAD = """\
# Operators

With this page you can call every operator from a script, and look up every setting. It is made by
`docs/make_operators.py` from the operators themselves: change them there, then run it.

Every operator is called `bpy.ops.patchnet.NAME(...)`. An argument that is not given is the scene's setting of that
name, `scene.patchnet.NAME`, which is what the panel shows; the last section lists them all. Giving `depth` or
`voxel_size` needs no `resolution` beside it. An error is a sentence in Blender's status bar, and a `RuntimeError` for
a script; then nothing was changed, or what is finished is kept for the next call. Octree and codes stay in memory
until another file is opened or Free Memory is pressed; they are not saved in the .blend file.

The lines are to be tried on a saved scene with a camera; they are small (`depth=6`, one sample) so that they end soon.
In background `scope` means all visible objects, in a window the selected ones.
"""


def page() -> str:
    """The whole page. Opens an empty file, in which operators are asked whether they would run."""
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
