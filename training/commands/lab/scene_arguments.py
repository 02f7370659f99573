# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes and camera tracks as arguments of research commands."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ....commands.shared.arguments import add_number
from ....commands.shared.lines import say_note
from ....patchnet_addon.runtime import bounds
from ... import bounds as lab_bounds
from ...evaluation.catalogue import SCENES, Scene, scene_named

if TYPE_CHECKING:
    from ...evaluation.tracks import TrackSettings


def add_track(parser: argparse.ArgumentParser, seeds: str = "the camera tracks") -> None:
    """Add --frames, --size and --seed of each scene's track. seeds: what the seed is of."""
    add_number(parser, "--frames", lab_bounds.TRACK_FRAMES, "frames of each scene's track", 2000)
    add_number(parser, "--size", bounds.VIEW_PX, "pixels", (130, 130), metavar=("WIDTH", "HEIGHT"))
    add_number(parser, "--seed", bounds.SEED, f"of {seeds}", 0)


def track_settings(args: argparse.Namespace, every: int = 1) -> TrackSettings:
    """Settings of a track from the arguments of `add_track`."""
    from ...evaluation.tracks import TrackSettings

    return TrackSettings(args.frames, every, tuple(args.size), args.seed)


def stated(args: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Arguments as results state them, with size and weights file."""
    found = {name: getattr(args, name) for name in names}
    return found | {"size": list(args.size), "weights": args.weights and args.weights.name}


def add_scenes(parser: argparse.ArgumentParser) -> None:
    """Add --scenes, names for `scenes_named`."""
    parser.add_argument(
        "--scenes", default="", metavar="NAME,NAME", help="scenes of the catalogue, or all with existing files; "
        "they are read from the folder PATCHNET_SCENES",
    )  # fmt: skip


ALL = "all"


def scenes_named(names: str) -> list[Scene]:
    """Scenes by comma-separated names; "all": those with existing files, with a note about the others.

    Raises SettingError for a name that is not in the catalogue.
    """
    if names != ALL:
        return [scene_named(name.strip()) for name in names.split(",") if name.strip()]
    scenes = [scene for scene in SCENES.values() if scene.is_there()]
    if absent := [f"{scene.name} ({scene.file})" for scene in SCENES.values() if scene not in scenes]:
        say_note(f"not evaluated, since files are missing: {', '.join(absent)}; --scenes NAME shows how to get one")
    return scenes
