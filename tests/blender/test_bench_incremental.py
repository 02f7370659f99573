# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet bench incremental` measures real bakes, an incremental one and a whole one of the same scene."""

import json
import os

import pytest

from patchnet.commands import main

SMALL = ["bench", "incremental", "--scene", "room", "--depth", "5", "--samples", "1"]


def test_incremental_and_whole_bakes(capsys: pytest.CaptureFixture[str]) -> None:
    cache = os.environ.get("PATCHNET_CACHE")
    assert main([*SMALL, "--object", "Short box", "--move", "0.1", "0", "0", "--tolerance", "1.0", "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert values["ours"] > 0 and values["ratio"] == pytest.approx(values["peer"] / values["ours"])
    assert 0 < values["triangles_baked"] < values["triangles"] and 0 < values["texels_baked"] < 1
    assert abs(values["stays_brighter_by"]) < 1.0
    assert os.environ.get("PATCHNET_CACHE") == cache


def test_objects_that_are_not_there_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*SMALL, "--object", "Nothing"]) == 2
    assert "no object 'Nothing'" in capsys.readouterr().err
