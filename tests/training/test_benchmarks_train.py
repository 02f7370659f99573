# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of training steps: what it measures and prints."""

import json

import pytest

from patchnet.commands import main
from patchnet.commands.benches import train
from patchnet.tests.torch_devices import DEVICES

pytest.importorskip("torch")


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("precision", ["auto", "fp32"])
def test_both_kinds_are_measured(capsys, precision: str, device: str) -> None:
    words = ["bench", "train", "--nodes", "60000", "--samples", "20000", "--repeats", "1", "--threads", "2"]
    words += ["--precision", precision, "--encoder-width", "64", "--device", device]
    assert main([*words, "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (values["name"], values["unit"], values["threads"]) == ("train", "samples per second", 2)
    rows, devices = values["rows"], 2 if device == "cuda" else 1
    assert [row["kind"] for row in rows] == ["mixture"] * devices + ["paper"] * devices
    for row in rows:
        assert row["samples_per_s"] == pytest.approx(1e3 * row["batch"] / row["step_ms"])
        assert row["samples_per_processor_s"] > 0 and row["batch"] in (2048, 8192)
        assert precision == "auto" or row["precision"] == "float32"
    assert values["ours"] == rows[0]["samples_per_s"]
    assert values["peer"] == (rows[1]["samples_per_s"] if device == "cuda" else None)
    assert f"| mixture | {rows[0]['device']} | 2,048 | {rows[0]['precision']} | " in train.text(values)


def test_a_device_that_is_not_there(capsys) -> None:
    assert main(["bench", "train", "--device", "cuda:777"]) == 2
    assert "--device 'cuda:777'" in capsys.readouterr().err
