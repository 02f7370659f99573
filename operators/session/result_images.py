# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender images of a view, named after its camera: pictures for display, and raw values of each pixel."""

from __future__ import annotations

import re
from hashlib import blake2b
from typing import TYPE_CHECKING

import bpy

from ..scene_access.images import PICTURES, drop_image, show_image
from ..scene_access.own import OWNER
from .shown_view import COVERAGE, LEVEL, LUMINANCES, PRIORITY, ShownView

if TYPE_CHECKING:
    from ..pipeline.views import View

RAW = (PRIORITY, COVERAGE, LEVEL, *LUMINANCES)
PAGES = {"heatmap": 1, "overlay": 1, "error": 2}  # pictures with a legend, and the number of views on them
_NAME = re.compile(r"PatchNet (.+?) ((?:cycles )?\w+)")
_NAME_BYTES = 34  # of a camera's name, so that Blender 4.5 does not truncate the image's name


def image_name(camera: str, name: str) -> str:
    """Name of an image, such as "PatchNet Camera priority"; `name`: of PICTURES or RAW."""
    if len(camera.encode()) > _NAME_BYTES:
        kept = camera.encode()[: _NAME_BYTES - 5].decode(errors="ignore")
        camera = f"{kept}~{blake2b(camera.encode(), digest_size=2).hexdigest()}"  # other names may begin alike
    return f"PatchNet {camera} {name}"


def shown_pictures() -> dict[str, dict[str, str]]:
    """Names of PatchNet's images except the raw ones: camera -> what it shows -> name."""
    found: dict[str, dict[str, str]] = {}
    for name in (image.get(OWNER, "") for image in bpy.data.images):
        match = _NAME.fullmatch(name)
        if match and not name.endswith(RAW):
            found.setdefault(match[1], {})[match[2]] = name
    return found


def show_images(view: View, shown: ShownView) -> dict[str, bpy.types.Image]:
    """Create or update all images of a view; raw ones are float, Non-Color. Unknown quantities have none, such as a
    missing reference and errors against it."""
    camera = view.camera.name
    images = {}
    for name in PICTURES:
        if name in view.pictures:
            images[name] = show_image(image_name(camera, name), view.pictures[name])
        else:
            drop_image(image_name(camera, name))
    for name in RAW:
        if name in shown.values:
            images[name] = show_image(image_name(camera, name), shown.values[name], raw=True)
        else:
            drop_image(image_name(camera, name))
    return images
