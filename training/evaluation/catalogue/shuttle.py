# SPDX-License-Identifier: GPL-3.0-or-later
"""Space shuttle of thousands of exact parts, in the place of the paper's airplane."""

from ..scene import TEST, TWO_LIGHTS, Scene

SCENE = Scene(
    name="shuttle",
    title="Shuttle",
    file="ldraw_space_shuttle.glb",
    light=TWO_LIGHTS,
    source="Parts of the LDraw.org parts library",
    licence="CC BY 2.0",
    role=TEST,
)
