# SPDX-License-Identifier: GPL-3.0-or-later
"""Courtyard of the demo, which the project builds by script and no weights were trained on."""

from ..scene import CYCLES, TEST, Scene

SCENE = Scene(
    name="courtyard",
    title="Courtyard",
    file="demo",
    light=CYCLES,
    source="built by `patchnet demo`",
    licence="GPL-3.0-or-later",
    role=TEST,
)
