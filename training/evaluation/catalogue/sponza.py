# SPDX-License-Identifier: GPL-3.0-or-later
"""Sponza, bisected along its length as in the paper, so that one can look into it from outside."""

from ..scene import TRAIN, TWO_LIGHTS, Scene

SCENE = Scene(
    name="sponza",
    title="Sponza",
    file="sponza_crytek.glb",
    light=TWO_LIGHTS,
    bisect=("y", 0.5),
    source="Sponza by Frank Meinl, Crytek",
    licence="geometry CC BY 3.0; licence of the textures not stated",
    role=TRAIN,
)
