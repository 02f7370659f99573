# SPDX-License-Identifier: GPL-3.0-or-later
"""What several settings have in common: bounds, units, choices. Name, description and default are each one's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bpy.props import EnumProperty, FloatProperty, IntProperty, StringProperty

from ..devices import AUTOMATIC, CPU, GPU

MOST_SAMPLES = 65536  # that Cycles takes
OF_ONE_CALL = {"SKIP_SAVE"}  # an operator forgets the value, so that the scene's counts for its next call


def share(name: str, description: str, default: float, update: Callable[..., None] | None = None) -> Any:
    """A part of a whole, 0 to 1."""
    return FloatProperty(
        name=name, description=description, default=default, min=0.0, max=1.0, subtype="FACTOR", update=update
    )


def automatic_at_zero(name: str, description: str, **bounds: float) -> Any:
    """A number that is found where it is 0, as it is from the start."""
    return FloatProperty(name=name, description=description, default=0.0, min=0.0, **bounds)


def sample_count(name: str, description: str, default: int, soft_max: int = MOST_SAMPLES) -> Any:
    """A number of Cycles' samples."""
    return IntProperty(name=name, description=description, default=default, min=1, soft_max=soft_max, max=MOST_SAMPLES)


def relative_path(name: str, description: str, subtype: str) -> Any:
    """A file ("FILE_PATH") or a folder ("DIR_PATH"); // stands for the folder of the .blend file."""
    return StringProperty(name=name, description=description, subtype=subtype, options={"PATH_SUPPORTS_BLEND_RELATIVE"})


def device_choice(name: str, description: str, automatic: str, cpu: str, gpu: str) -> Any:
    """What computes; what each choice means."""
    items = [(AUTOMATIC, "Automatic", automatic), (CPU, "CPU", cpu), (GPU, "GPU", gpu)]
    return EnumProperty(name=name, description=description, items=items, default=AUTOMATIC)
