# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of training steps: which products are recorded, and what it prints."""

import json

import pytest

from patchnet.commands import main
from patchnet.commands.benches import train

torch = pytest.importorskip("torch")
from patchnet.training.benchmarks import training_rate  # noqa: E402
from patchnet.training.benchmarks.step_products import operations, recorded_products, replay  # noqa: E402
from patchnet.training.benchmarks.training_rate import has_matrix_units  # noqa: E402


def test_products_forward_and_backward_are_recorded() -> None:
    layer, values = torch.nn.Linear(3, 5), torch.ones(7, 3, requires_grad=True)
    with recorded_products() as products:
        layer(values).sum().backward()
    assert [(first.shape, second.shape) for first, second in products] == [
        ((7, 3), (3, 5)), ((7, 5), (5, 3)), ((5, 7), (7, 3))
    ]  # fmt: skip
    assert operations(products) == 3 * 2 * 7 * 3 * 5
    assert all(operand.dtype == torch.float32 for pair in products for operand in pair)
    replay(products)()


@pytest.mark.parametrize(("allowed", "used"), [("", True), ("AVX512_CORE_AMX", True), ("avx512_core_bf16", False)])
def test_matrix_units_are_used_where_they_are_and_may_be(monkeypatch, allowed: str, used: bool) -> None:
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", allowed)
    for there in (True, False):
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda there=there: {"amx_bf16": there}, raising=False)
        assert has_matrix_units() == (there and used)


@pytest.mark.parametrize(("threads", "precision"), [(1, "auto"), (2, "fp32")])
def test_both_kinds_are_measured(capsys, monkeypatch, threads: int, precision: str) -> None:
    for name in ("_WARM", "_TIMES"):  # for good figures, which take long
        monkeypatch.setattr(training_rate, name, 1)
    words = ["bench", "train", "--nodes", "60000", "--samples", "20000", "--repeats", "1", "--threads", str(threads)]
    words += ["--precision", precision, "--encoder-width", "64"]
    assert main([*words, "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (values["name"], values["unit"], values["threads"]) == ("train", "samples per second", threads)
    assert values["clock"] == ("processor" if threads == 1 else "wall")
    assert values["encoder_width"] == 64
    assert list(values["kinds"]) == ["mixture", "paper"]
    for row in values["kinds"].values():
        assert row["share"] == pytest.approx(row["samples_per_s"] / row["products_samples_per_s"])
        assert row["share_of_float32"] == pytest.approx(row["samples_per_s"] / row["float32_products_samples_per_s"])
        assert row["gflop"] > 0.3 and row["batch"] in (2048, 8192)
        if precision == "fp32":
            assert row["precision"] == "float32"
            gflop = 1e-3 * row["float32_products_ms"] * row["gflops_of_float32_products"]
            assert row["gflop"] == pytest.approx(gflop, rel=0.1)  # four steps' mean, and the first one's
    assert values["ratio"] == pytest.approx(values["kinds"]["mixture"]["share"])
    text = train.text(values)
    assert f"| mixture | 2,048 | {values['kinds']['mixture']['precision']} | " in text
    assert f"{'with' if values['matrix_units'] else 'without'} matrix units" in text
