# SPDX-License-Identifier: GPL-3.0-or-later
"""Space station of trusses and panels."""

from ..scene import TEST, TWO_LIGHTS, Scene

SCENE = Scene(
    name="station",
    title="Space station",
    file="ldraw_iss.glb",
    light=TWO_LIGHTS,
    source="Parts of the LDraw.org parts library",
    licence="CC BY 2.0",
    role=TEST,
)
