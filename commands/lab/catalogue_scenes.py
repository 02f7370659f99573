# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes of the evaluation's catalogue by the names that a command was given."""

from __future__ import annotations

from ...training.evaluation.catalogue import SCENES, Scene, scene_named
from ..shared.lines import say_note

ALL = "all"


def scenes_named(names: str) -> list[Scene]:
    """Scenes of names with commas between; "all": those whose files are there, with a note that names the others.

    Raises SettingError for a name that is not in the catalogue, before anything long begins.
    """
    if names != ALL:
        return [scene_named(name.strip()) for name in names.split(",") if name.strip()]
    scenes = [scene for scene in SCENES.values() if scene.is_there()]
    if absent := [f"{scene.name} ({scene.file})" for scene in SCENES.values() if scene not in scenes]:
        say_note(f"not evaluated, since their files are not there: {', '.join(absent)}; --scenes NAME says more")
    return scenes
