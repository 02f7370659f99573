# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of training steps: which products there are in a step, and what it prints."""

import json
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from patchnet.commands import main
from patchnet.commands.benches import train
from patchnet.patchnet_addon.network.kinds import MIXTURE, PAPER, NetworkKind
from patchnet.patchnet_addon.network.weights import Weights

torch = pytest.importorskip("torch")
from torch.utils._python_dispatch import TorchDispatchMode  # noqa: E402

from patchnet.training.benchmarks import training_rate  # noqa: E402
from patchnet.training.benchmarks.step_products import operations, replay, step_products  # noqa: E402
from patchnet.training.benchmarks.training_rate import TrainBench, has_matrix_units  # noqa: E402
from patchnet.training.data.batches import Augmentation  # noqa: E402
from patchnet.training.data.corpus import corpus_of  # noqa: E402
from patchnet.training.data.tensor_batch import TensorBatch  # noqa: E402
from patchnet.training.network import sliced_net  # noqa: E402


def recorded(work: Callable[[], object]) -> list[tuple[tuple[int, ...], ...]]:
    """Sizes of both factors of all products that torch does meanwhile."""
    found = []

    class Recorder(TorchDispatchMode):
        def __torch_dispatch__(self, function, types, arguments=(), keywords=None):
            if function.overloadpacket in (torch.ops.aten.mm, torch.ops.aten.bmm, torch.ops.aten.addmm):
                found.append(tuple(tuple(each.shape) for each in arguments[-2:]))
            return function(*arguments, **(keywords or {}))

    with Recorder():
        work()
    return found


@pytest.mark.parametrize(("kind", "dtype"), [(MIXTURE, torch.float32), (PAPER, torch.bfloat16), (PAPER, torch.float32)])
def test_products_are_those_that_torch_does(kind: NetworkKind, dtype: torch.dtype) -> None:
    """Those of the encoder as recorded where torch does them, and the decoder's by their sizes."""
    corpus, _ = corpus_of([training_rate._made(TrainBench(nodes=20_000, samples=2_000))], nearby=kind.mixes)
    batch = TensorBatch.of(corpus.batch(np.arange(24), Augmentation.none(24)))
    net = sliced_net.SlicedNet(Weights.random(0, kind=kind))
    products = step_products(batch, kind, 256, dtype)
    sizes = [(first.shape, second.shape) for first, second in products]
    count = 2 + 3 * 3
    found = recorded(lambda: torch.autograd.grad(net._codes(batch, dtype).sum(), net.trained(), allow_unused=True))
    assert sorted(found) == sorted(sizes[:count])
    layers = list(pairwise(kind.decoder))
    views = batch.ratio.numel()
    assert len(sizes) == count + 3 * len(layers) and sizes[count] == ((views, layers[0][0]), layers[0])
    without = layers[0][0] - (10 + 8 * 4 if kind.mixes else 10)  # inputs that codes have no part in
    all_of = sum(3 * inputs * outputs for inputs, outputs in layers) - without * layers[0][1]
    assert operations(products[count:]) == 2 * views * all_of
    replay(products)()


@pytest.mark.parametrize(("allowed", "used"), [("", True), ("AVX512_CORE_AMX", True), ("avx512_core_bf16", False)])
def test_matrix_units_are_used_where_they_are_and_may_be(monkeypatch, allowed: str, used: bool) -> None:
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", allowed)
    for there in (True, False):
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda there=there: {"amx_bf16": there}, raising=False)
        assert has_matrix_units() == (there and used)


@pytest.mark.parametrize(("threads", "precision"), [(1, "auto"), (2, "fp32")])
def test_both_kinds_are_measured(capsys, monkeypatch, threads: int, precision: str) -> None:
    for name in ("_WARM", "_TIMES", "_BEFORE"):  # for good figures, which take long
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
