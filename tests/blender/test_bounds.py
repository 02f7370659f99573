# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of Blender's properties equal the table; other values are refused."""

import math
from collections.abc import Iterator

import bpy
import pytest

from patchnet.operators.overlay.overlay_settings import PatchNetOverlaySettings
from patchnet.operators.properties.preferences import PatchNetPreferences
from patchnet.operators.properties.stages import PatchNetSettings
from patchnet.operators.registration import _MODULES, classes_of
from patchnet.patchnet_addon.runtime import bounds

ROWS = [row for row in vars(bounds).values() if isinstance(row, bounds.Bounds)]


def of_the_table(low: float, high: float) -> bool:
    """Compare a row's bounds with these, in the single precision of Blender; or 0 for automatic below its high one."""
    same = [row for row in ROWS if math.isclose(row.high, high, rel_tol=1e-6)]
    return any(low == 0.0 or math.isclose(row.low, low, rel_tol=1e-6) for row in same)


def numbers() -> Iterator[tuple[str, bpy.types.Property]]:
    """All numbers that our operators, settings and preferences declare."""
    declared = (item for module in _MODULES for item in classes_of(module))
    of_operators = [item for item in declared if issubclass(item, bpy.types.Operator)]
    for item in (*of_operators, PatchNetSettings, PatchNetOverlaySettings, PatchNetPreferences):
        rna = item.bl_rna
        if item in of_operators:
            rna = getattr(bpy.ops.patchnet, item.bl_idname.partition(".")[2]).get_rna_type()
        ours = {name for base in item.__mro__ for name in getattr(base, "__annotations__", {})}
        for name, prop in rna.properties.items():
            if name in ours and prop.type in ("INT", "FLOAT"):
                yield f"{item.__name__}.{name}", prop


def test_every_number_of_ours_has_bounds_of_the_table(registered: None) -> None:
    found = dict(numbers())
    assert len(found) > 30
    assert not [name for name, prop in found.items() if not of_the_table(prop.hard_min, prop.hard_max)]


@pytest.mark.parametrize(
    "name", ["memory", "voxel_size", "noise_threshold", "exposure", "budget", "spp", "heatmap_maximum"]
)
def test_nan_is_refused_with_a_sentence(name: str, scene: bpy.types.Scene) -> None:
    scene.patchnet.resolution = "VOXEL_SIZE" if name == "voxel_size" else "DEPTH"
    setattr(scene.patchnet, name, math.nan)
    with pytest.raises(RuntimeError, match=r"nan is outside .* to "):
        bpy.ops.patchnet.run_all(light="two-lights")
