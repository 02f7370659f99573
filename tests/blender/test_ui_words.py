# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels and tooltips: American spelling, no internal terms, units."""

import re
from collections.abc import Iterator

import bpy
import pytest

from patchnet.operators.overlay.overlay_settings import PatchNetOverlaySettings
from patchnet.operators.properties.preferences import PatchNetPreferences
from patchnet.operators.properties.stages import PatchNetSettings, camera_candidates
from patchnet.operators.scene_access.lengths import length_text
from patchnet.tests.blender.job_scene import build
from patchnet.tests.blender.objects import new_camera

pytestmark = pytest.mark.usefixtures("registered")

BRITISH = re.compile(
    r"colour|grey|centre|metre|neighbour|behaviour|licence|catalogue|(normal|optim|visual|initial|rasteri|summar)is(e|ing)",
    re.I,
)
PRIVATE = re.compile(r"\bcodes?\b|paths of a side|\bcorner codes\b|\bhits\b", re.I)


def said_by(rna: bpy.types.Struct) -> Iterator[str]:
    """Labels and tooltips of all properties, and of their choices."""
    for item in rna.properties:
        if item.identifier in ("rna_type", "name") or item.identifier.startswith("bl_"):
            continue
        yield from (item.name, item.description)
        if item.type == "ENUM":
            for choice in item.enum_items:
                yield from (choice.name, choice.description)


def said() -> Iterator[str]:
    """All labels and tooltips of PatchNet."""
    for group in (PatchNetSettings, PatchNetOverlaySettings, PatchNetPreferences):
        yield from said_by(group.bl_rna)
    for name in dir(bpy.types):
        if name.startswith("PATCHNET_"):
            kind = getattr(bpy.types, name)
            yield from (kind.bl_label, kind.bl_rna.description)
            if name.startswith("PATCHNET_OT_"):
                yield from said_by(kind.bl_rna)


def test_words() -> None:
    texts = list(said())
    assert len(texts) > 300
    own = [item for item in PatchNetSettings.bl_rna.properties if item.identifier not in ("rna_type", "name")]
    kinds = [getattr(bpy.ops.patchnet, name).get_rna_type() for name in dir(bpy.ops.patchnet)]
    assert [item.identifier for item in (*own, *kinds) if not (item.name and item.description)] == []
    assert not [text for text in texts if BRITISH.search(text)]
    assert not [text for text in texts if PRIVATE.search(text)]


def test_lengths_have_the_units_of_the_scene() -> None:
    build()
    units = bpy.context.scene.unit_settings
    found = []
    for system in ("METRIC", "IMPERIAL", "NONE"):
        units.system = system
        found.append(length_text(bpy.context.scene, 0.01172))
    assert found == ["1.172 cm", "461.4 thou", "0.01172 units"]
    units.system, units.scale_length = "METRIC", 10.0
    assert length_text(bpy.context.scene, 0.01172) == "11.72 cm"


def test_cameras_are_searched_for() -> None:
    build()
    scene = bpy.context.scene
    for name in ("Far", "Near"):
        new_camera(name)

    def names(text: str) -> list[str]:
        return [name for name, _ in camera_candidates(None, bpy.context, text)]

    assert names("") == names("Ne") == ["Eye", "Far", "Near", "all", "auto"]
    assert names("Far, ") == ["Far, Eye", "Far, Near"]
    assert names("Far, Eye,N") == ["Far, Eye, Near"]
    assert dict(camera_candidates(None, bpy.context, ""))["Eye"] == "Active camera"
    scene.patchnet.cameras = "Far, Near"  # several stay possible
    assert scene.patchnet.cameras == "Far, Near"
