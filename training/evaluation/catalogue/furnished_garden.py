# SPDX-License-Identifier: GPL-3.0-or-later
"""Garden with people behind a fence of thin bars, of a library that nothing is trained on."""

from ..scene import CYCLES, TEST, Scene

SCENE = Scene(
    name="furnished-garden",
    title="Furnished garden",
    file="furnished_garden.glb",
    light=CYCLES,
    source="people by Reallusion, the garden and its plants built by `patchnet lab furnish`",
    licence="CC BY 3.0 US; GPL-3.0-or-later",
    role=TEST,
    composed="furnish Reallusion.sh3f --kind garden --seed 1",
)
