# SPDX-License-Identifier: GPL-3.0-or-later
"""Furnished room with people, of a library that nothing is trained on; without its ceiling, so that one looks in."""

from ..scene import CYCLES, TEST, Scene

SCENE = Scene(
    name="furnished-room",
    title="Furnished room",
    file="furnished_room.glb",
    light=CYCLES,
    without=("ceiling",),  # closed, it would be dark beside its sunlit outside
    source="people by Reallusion, the room and its furniture built by `patchnet lab furnish`",
    licence="CC BY 3.0 US; GPL-3.0-or-later",
    role=TEST,
    composed="furnish Reallusion.sh3f --kind interior --seed 1",
)
