# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet lab evaluate` on a small octree: files, skipped work, refusals."""

import json
import re

import numpy as np
import pytest

from patchnet.training.commands import main
from patchnet.training.evaluation import evaluate
from patchnet.training.strategies.registry import EVALUATED

WORDS = ["--frames", "40", "--every", "4", "--size", "32", "24", "--processes", "1"]


@pytest.fixture(scope="module")
def done(shells_path, tmp_path_factory):
    """Folder of an evaluation of one octree."""
    pytest.importorskip("matplotlib")
    out = tmp_path_factory.mktemp("evaluation")
    with pytest.MonkeyPatch.context() as context:
        context.setattr(evaluate, "_COST_FRAMES", 1)
        context.setattr(evaluate, "_COST_REPEATS", 1)
        assert main(["lab", "evaluate", str(shells_path), *WORDS, "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def results(done):
    return json.loads((done / "results.json").read_text(encoding="utf-8"))


def test_curves_of_every_strategy(results):
    values = results["scenes"]["shells"]
    assert values["budgets"] == [share / 100 for share in range(101)] and values["frames"] == 10
    assert values["mse"].keys() == values["rays_per_pixel"].keys() == values["intervals"].keys() == EVALUATED.keys()
    start, best = values["mse"]["random"][0], np.array(values["mse"]["optimal"])
    np.testing.assert_allclose(values["mse"]["random"], np.linspace(start, 0, 101), atol=0.05 * start)
    assert start > 0 and 0 < values["lookahead_share"] <= 1
    for name, curve in values["mse"].items():
        assert len(curve) == 101 and curve[0] == pytest.approx(start) and curve[100] == pytest.approx(0, abs=1e-12)
        assert (np.array(curve) >= best - 1e-6 * start).all(), "nothing is below what knows the errors"
        assert (np.diff(curve) <= 1e-9 * start).all(), "errors fall"
        low, high = (np.array(values["intervals"][name][end]) for end in ("low", "high"))
        assert (low <= np.array(curve) + 1e-12).all() and (np.array(curve) <= high + 1e-12).all()
    assert values["rays_per_pixel"]["fine-rays-4"] == 5 and values["rays_per_pixel"]["patchnet"] == 1


def test_costs_of_all_but_those_that_know_the_reference(results):
    values = results["scenes"]["shells"]
    assert values["ms_per_frame"].keys() == EVALUATED.keys() - {"optimal"}
    assert all(milliseconds > 0 for milliseconds in values["ms_per_frame"].values())
    assert values["uniform"]["1"]["mse"] == pytest.approx(values["mse"]["random"][0])
    assert values["uniform"]["4"]["mse"] < values["uniform"]["1"]["mse"]


def test_predicted_picture_beside_uniform_ones(done, results):
    values = results["scenes"]["shells"]
    (picture,) = values["predicted"].values()
    assert values["predicted"].keys() == {"predicted"} and picture["rays_per_pixel"] == 2
    assert picture["mse"] > 0 and picture["ms_per_frame"] > 0
    assert f"{1e4 * picture['mse']:.1f} in {picture['ms_per_frame']:.1f} ms" in (done / "tables.md").read_text()


def test_figures(done):
    names = {path.name for path in (done / "figures").iterdir()}
    assert names == {f"shells-{kind}.{ending}" for kind in ("budget", "time") for ending in ("png", "svg")}


def test_tables_have_the_figures_of_the_results(done, results):
    text = (done / "tables.md").read_text(encoding="utf-8")
    mse = results["scenes"]["shells"]["mse"]
    assert f"| `optimal` | {mse['optimal'][30] / mse['ss-variance'][30]:.2f} |" in text
    assert all(f"| `{name}` |" in text for name in EVALUATED.keys() - {"random"})
    widths = [line.count("|") for table in text.split("\n\n") for line in table.splitlines() if line.startswith("|")]
    assert min(widths) > 2 and not re.search(r"\bnan\b", text)
    assert re.search(r"^\| 1 \| `fine-ray` \|", text, re.MULTILINE), "one further ray"
    (row,) = re.findall(r"^\| `patchnet-plus-1` \| `fine-ray` \| budget \| (.*) \|$", text, re.MULTILINE)
    ratio = mse["patchnet-plus-1"][30] / mse["fine-ray"][30]
    assert row.split(" | ")[3] == f"{ratio < 1:d} ({ratio:.3f})"


def test_what_is_done_is_skipped_and_what_is_damaged_is_made_again(shells_path, done):
    blocks = sorted((done / "scenes" / "shells" / "frames").iterdir())
    before = [path.stat().st_mtime_ns for path in blocks]
    kept = (done / "results.json").read_text(encoding="utf-8")
    damaged = bytearray(blocks[-1].read_bytes())
    damaged[-20] ^= 255
    blocks[-1].write_bytes(bytes(damaged))
    assert main(["lab", "evaluate", str(shells_path), *WORDS, "--out", str(done)]) == 0
    after = [path.stat().st_mtime_ns for path in blocks]
    assert before[:-1] == after[:-1] and before[-1] != after[-1]
    assert (done / "results.json").read_text(encoding="utf-8") == kept, "the same to the last digit"


@pytest.mark.parametrize(
    "words, message",
    [
        ([], "There is nothing to evaluate: name --scenes, or octree files"),
        (["--scenes", "moon"], "Unknown scene 'moon': choose one of"),
        (["missing.safetensors"], "missing.safetensors"),
        (["shells.safetensors", "--weights", "none.safetensors"], "none.safetensors"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(words, message, shells_path, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(shells_path.parent)
    assert main(["lab", "evaluate", *words, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
