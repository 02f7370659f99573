# SPDX-License-Identifier: GPL-3.0-or-later
"""Training by several processes of torchrun takes the steps of one."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.tests.training.procedural import draw_slats
from patchnet.training.data.samples import SampleSettings

pytest.importorskip("torch")
from patchnet.training.run.processes import Processes

STEPS, BATCH = 12, 128


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = SampleSettings(views=4, min_level=3, seed=2)
    return draw_slats(tmp_path_factory.mktemp("samples"), 2000, settings)


def train(samples: Path, out: Path, *launcher: str) -> list[dict]:
    """Lines of the log of a run that `launcher` starts."""
    words = ["lab", "train", samples, "--out", out, "--preset", "quick", "--passes", STEPS * BATCH, "--batch", BATCH]
    words += ["--precision", "fp32", "--threads", "1", "--rate", "1e-4"]  # at high rates rounding grows
    command = [sys.executable, *launcher, "-m", "patchnet", *map(str, words)]
    done = subprocess.run(command, env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def test_two_processes_take_the_steps_of_one(samples: Path, tmp_path: Path) -> None:
    launcher = ("-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2")
    alone, together = train(samples, tmp_path / "alone"), train(samples, tmp_path / "together", *launcher)
    assert len(alone) == len(together)
    for one, other in zip(alone, together, strict=True):
        if "coverage" in one:
            assert other["coverage"] == pytest.approx(one["coverage"], rel=1e-3)
    weights = [load_weights(tmp_path / name / "patchnet.safetensors") for name in ("alone", "together")]
    for one, other in zip(*(found.arrays().values() for found in weights), strict=True):
        np.testing.assert_allclose(other, one, atol=2e-4)  # Adam divides by small numbers


def test_shares_are_all_and_none_twice() -> None:
    parts = [range(10)[Processes(rank, 3).part(10)] for rank in range(3)]
    assert [one for part in parts for one in part] == list(range(10))


@pytest.mark.parametrize(
    "said",
    [{"WORLD_SIZE": "many"}, {"WORLD_SIZE": "0"}, {"RANK": "2"}, {"RANK": "-1"}, {"WORLD_SIZE": "2"}],
    ids=lambda said: " ".join(f"{name}={value}" for name, value in said.items()),
)
def test_what_torchrun_does_not_say(said: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT"):
        monkeypatch.delenv(name, raising=False)
    for name, value in said.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SettingError, match="start them with torchrun"):
        Processes.joined()
