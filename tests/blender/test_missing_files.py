# SPDX-License-Identifier: GPL-3.0-or-later
"""Warnings name files that a scene refers to and that are missing."""

from pathlib import Path

import bpy
import pytest

from patchnet.patchnet_addon.runtime.errors import EmptySelectionError
from patchnet.tests.blender.job_scene import build, principled, saved
from patchnet.tests.blender.objects import read


def warnings() -> str:
    return "\n".join(read().warnings)


def with_texture(path: str, source: str = "FILE") -> None:
    """The small scene, its slab with an image from `path`, which may not be there."""
    build()
    color = principled("Slab").inputs["Base Color"]
    bpy.data.materials["Slab"].name = "Painted"
    tree = color.id_data
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.new("picture", 4, 4)
    node.image.source, node.image.filepath = source, path
    tree.links.new(node.outputs["Color"], color)


def test_missing_image_is_named_with_its_path_and_material(tmp_path: Path) -> None:
    with_texture(str(tmp_path / "wood.png"))
    assert f"Images are missing, which Cycles shows in pink: {tmp_path / 'wood.png'} (material 'Painted')" in warnings()


def test_image_that_is_there_or_packed_is_not_named(tmp_path: Path) -> None:
    path = tmp_path / "wood.png"
    image = bpy.data.images.new("made", 4, 4)
    image.file_format, image.filepath_raw = "PNG", str(path)
    image.save()
    with_texture(str(path))
    assert "missing" not in warnings()
    bpy.data.images["picture"].pack()
    path.unlink()
    assert "missing" not in warnings()


def test_missing_tiles_are_named(tmp_path: Path) -> None:
    with_texture(str(tmp_path / "wood.<UDIM>.png"), "TILED")
    assert str(tmp_path / "wood.1001.png") in warnings()


@pytest.fixture
def linked(tmp_path: Path) -> tuple[Path, Path]:
    """A library, and a file that links the slab of it and has no other surface."""
    library, user = tmp_path / "library.blend", tmp_path / "user.blend"
    build()
    saved(library)
    build()
    bpy.data.batch_remove([item for item in bpy.data.objects if item.type == "MESH"])
    with bpy.data.libraries.load(str(library), link=True) as (_, into):
        into.objects = ["Slab"]
    bpy.context.scene.collection.objects.link(into.objects[0])
    saved(user)
    return library, user


def test_missing_library_is_named_where_nothing_is_left(linked: tuple[Path, Path]) -> None:
    library, user = linked
    library.unlink()
    bpy.ops.wm.open_mainfile(filepath=str(user))
    with pytest.raises(EmptySelectionError, match=f"Linked libraries are missing: {library}"):
        warnings()


def test_data_that_a_library_lacks_is_named(linked: tuple[Path, Path]) -> None:
    library, user = linked
    build()
    bpy.data.objects["Slab"].name = "Renamed"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.open_mainfile(filepath=str(user))
    with pytest.raises(EmptySelectionError, match=f"Library {library} lacks object 'Slab'"):
        warnings()
