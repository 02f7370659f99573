# SPDX-License-Identifier: GPL-3.0-or-later
"""Model card, script, help and training page state the numbers of the shipped weights."""

import re
from dataclasses import replace
from pathlib import Path

from patchnet.patchnet_addon.network.weights import default_weights_path, load_weights
from patchnet.training.commands.lab.train import description
from patchnet.training.settings import PRESETS, SAMPLES, SHIPPED_PASSES, SHIPPED_WIDTH, VIEWS, TrainSettings

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "lab" / "training.md").read_text()
SCRIPT = (ROOT / "training" / "shipped_weights.sh").read_text()
CARD = default_weights_path().with_name("model_card.md").read_text()


def rows(heading: str) -> list[list[str]]:
    """Cells of the table below a heading of the card, without its head."""
    part = CARD.split(heading, 1)[1].split("\n## ", 1)[0]
    lines = [line for line in part.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def learned() -> list[list[str]]:
    """Rows of the data that was learned from."""
    return [row for row in rows("## Data") if row[5] == "training"]


def test_card_says_what_the_weights_say() -> None:
    weights = load_weights()
    metadata = weights.metadata
    assert weights.hash in CARD and metadata["command"] in CARD and metadata["versions"] in CARD
    assert f"{metadata['sample_passes']:,} sample passes in {metadata['steps']:,} steps" in CARD
    settings = metadata["settings"]
    stated = [[name, str(settings[name])] for name in TrainSettings.__dataclass_fields__ if name in settings]
    assert rows("## How they were made") == stated
    assert [row[0] for row in learned()] == metadata["data"]
    assert {row[0]: row[8].strip("`") for row in learned()} == metadata["octrees"]
    assert f"Hash of the code: `{metadata['code']}`" in CARD


def test_weights_are_of_the_preset() -> None:
    wanted = replace(PRESETS["improved"], passes=SHIPPED_PASSES, encoder_width=SHIPPED_WIDTH, fresh=True)
    assert TrainSettings(**load_weights().metadata["settings"]) == wanted


def test_card_counts_no_training_scene_as_held_out() -> None:
    training, unseen = {row[0] for row in learned()}, {row[0] for row in rows("## Errors on held-out scenes")}
    assert len(unseen) >= 5 and not training & unseen
    scenes = {use: {row[1] for row in rows("## Data") if row[5] == use} for use in ("training", "validation")}
    assert not scenes["training"] & scenes["validation"]
    known = rows("## Errors on scenes that are in training")
    assert {row[0] for row in known} == training
    assert all(row[6].startswith("not held out: ") for row in known)


def test_script_page_and_help_have_the_numbers() -> None:
    passes = load_weights().metadata["sample_passes"]
    assert " --fresh " in SCRIPT and f"--encoder-width {SHIPPED_WIDTH} --passes {passes} " in SCRIPT
    assert set(re.findall(r"^octree (\S+)", SCRIPT, re.MULTILINE)) == set(load_weights().metadata["data"])
    text = description()
    assert f"--samples {SAMPLES} " in text and f"{VIEWS} views" in text and f"{passes:,} passes" in text
    assert f"{passes // 10**6} M sample passes" in " ".join(PAGE.split())
