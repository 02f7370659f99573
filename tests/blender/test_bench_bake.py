# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet bench bake` measures real calls of Cycles."""

import json

import pytest

from patchnet.commands import main


def test_rates_of_bake_and_renders(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "bake", "--scene", "room", "--depth", "6", "--samples", "1", "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert values["ours"] > 0 and values["peer"] > 0
    assert values["ratio"] == pytest.approx(values["ours"] / values["peer"])
    baked = sum(turn["paths"] for turn in values["pages"])
    assert baked >= values["paths_a_side"] > 0.6 * values["atlas_use"] * 1000
    for page, render in zip(values["pages"], values["renders"], strict=True):
        assert min(page["processor_s"], page["wall_s"], render["processor_s"], render["wall_s"]) > 0
        assert 0.8 < render["paths"] / page["paths"] < 1.25
    assert 0.5 < values["atlas_use"] <= 1.0
