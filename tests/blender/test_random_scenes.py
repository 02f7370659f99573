# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes of `patchnet check-scenes`: seeds, verdicts, and the light of scenes known to be right."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import bpy
import pytest

from patchnet.patchnet_addon.runtime.errors import SceneError
from patchnet.training import commands
from patchnet.training.commands.checks import judge as judging
from patchnet.training.commands.checks.judge import RIGHT, SAID, WRONG, judge, shortfall
from patchnet.training.commands.checks.random_scene import build_random_scene

KNOWN = dict.fromkeys((5, 10, 12, 13, 14, 64, 66, 75, 81), RIGHT) | dict.fromkeys((63, 76), SAID)
"""Verdicts on the seeds that every run of the tests judges; `patchnet check-scenes` judges others."""


@pytest.mark.parametrize("seed", KNOWN)
def test_light_of_known_seeds_is_right_or_said_to_differ(seed: int) -> None:
    build_random_scene(seed)
    verdict = judge()
    assert verdict.word == KNOWN[seed], verdict.why
    if verdict.word == RIGHT:
        (seen,) = verdict.check.cameras
        short_db, wrong = shortfall(seen)
        assert short_db <= 0.0 and not wrong
        key = "mean_ratio_where_both_hit"
        dark = replace(seen, report=seen.report | {key: 0.8 * seen.report[key]})
        assert shortfall(dark)[1], "a fifth is missing"


DESCRIBE = """
import os, sys
import bpy
from patchnet.training.commands.checks.random_scene import build_random_scene

for seed in range(1, 9):
    build_random_scene(seed)
    for item in bpy.data.objects:
        print("IS", item.name, item.type, item.matrix_world, [each.type for each in item.modifiers])
    for tree in [material.node_tree for material in bpy.data.materials if material.node_tree]:
        print("IS", [(link.from_node.bl_idname, link.to_socket.name) for link in tree.links])
sys.stdout.flush()
os._exit(0)
"""


def described(hash_seed: str) -> list[str]:
    environment = os.environ | {"PYTHONHASHSEED": hash_seed}
    done = subprocess.run([sys.executable, "-c", DESCRIBE], capture_output=True, text=True, env=environment, check=True)
    return [line for line in done.stdout.splitlines() if line.startswith("IS")]


def test_a_seed_gives_the_same_scene_in_every_process() -> None:
    first = described("1")
    assert len(first) > 40 and first == described("2")


def test_the_command_goes_on_after_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        if bpy.context.scene.name == "Seed 2":
            raise SceneError("This scene is said to be unusable")
        raise IndexError("by accident")

    monkeypatch.setattr(judging, "verify_light", fails)
    assert commands.main(["check-scenes", "--seeds", "1:2", "--out", str(tmp_path / "out")]) == 0
    first, second, total = capsys.readouterr().out.splitlines()[-3:]
    assert "1 wrong IndexError('by accident') in test_random_scenes.py" in first
    assert "2 said  This scene is said to be unusable" in second
    assert total == "2 scenes: 0 right, 1 said, 1 wrong"
    rows = json.loads((tmp_path / "out" / "report.json").read_text())["seeds"]
    assert [(row["seed"], row["verdict"]) for row in rows] == [(1, WRONG), (2, SAID)]
    assert (tmp_path / "out" / "seed-1" / "scene.blend").is_file()


@pytest.mark.parametrize("seeds", ["5", "5:3", "a:b"])
def test_seeds_are_two_numbers(seeds: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        commands.main(["check-scenes", "--seeds", seeds])
    assert "is not two seeds in ascending order" in capsys.readouterr().err
