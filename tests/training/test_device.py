# SPDX-License-Identifier: GPL-3.0-or-later
"""Training on devices and by any number of threads: the same batches, the same steps to rounding, runs that move."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.network.kinds import MIXTURE
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.patchnet_addon.runtime.errors import SettingError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.torch_devices import DEVICES, GPU, gpu_only
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.training.data.batches import Augmentation, block_values
from patchnet.training.data.corpus import corpus_of
from patchnet.training.data.dataset import Dataset, save_samples
from patchnet.training.data.samples import SampleSettings, draw_samples
from patchnet.training.settings import SQUARED, TrainSettings

torch = pytest.importorskip("torch")
from patchnet.patchnet_addon.network.torch_precision import float32_products  # noqa: E402  needs torch
from patchnet.training.benchmarks import device as device_bench  # noqa: E402  needs torch
from patchnet.training.data.padded_batch import BatchLayout, PaddedBatch  # noqa: E402  needs torch
from patchnet.training.data.tensor_batch import TensorBatch  # noqa: E402  needs torch
from patchnet.training.run.crews import ALONE, GpuCrew, StepPlan, ThreadCrew, crew_for, plan_of_step  # noqa: E402
from patchnet.training.run.learner import Learner  # noqa: E402  needs torch
from patchnet.training.run.trainer import RunOptions, encoder_type, train  # noqa: E402  needs torch

SETTINGS = TrainSettings(passes=6 * 256, batch=256, precision="fp32", augment=True, average=0.9, clip=1.0, warm_up=2)
VOXELS = 64
GRADIENTS = {"cpu": 1e-5, "cuda": 5e-3}  # of the norm: on a GPU a ReLU's input may round to the other side of zero
ERRORS = 1e-3  # relative, of the curves of a short run


MIXING = replace(SETTINGS, network=MIXTURE.name, loss=SQUARED)


def drawn(lookahead: int) -> list[Dataset]:
    found = []
    for seed in (1, 2):
        octree = spheres_and_slats(6, seed=seed)
        settings = SampleSettings(views=4, min_level=2, held_out=0.05, seed=seed, lookahead=lookahead)
        samples = drain(draw_samples(octree, 400, settings))
        found.append(Dataset(f"scene {seed}", octree, samples, {"settings": {"lookahead": lookahead}}))
    return found


@pytest.fixture(scope="module")
def datasets() -> list[Dataset]:
    return drawn(2)


@pytest.fixture(autouse=True)
def parts_of_few_voxels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps of these tests have as many parts as ones of four times as many voxels."""
    monkeypatch.setattr("patchnet.training.run.crews._PART_VOXELS", 16)


def curve(folder: Path) -> np.ndarray:
    """Coverage and luminance errors (n, 2) of a log."""
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return np.array([(line["coverage"], line["luminance"]) for line in lines if "coverage" in line])


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("nearby", [False, True])
@pytest.mark.parametrize("lookahead", [1, 2, 3])
def test_batches_of_one_shape(lookahead: int, nearby: bool, device: str) -> None:
    """Networks say and learn the same of them; a layout's memory is used again, by a smaller batch after a larger."""
    corpus, _ = corpus_of(drawn(lookahead), nearby=nearby)
    settings = MIXING if nearby else SETTINGS
    models = [Learner(settings, lookahead, where).model for where in ("cpu", device)]
    order = np.random.default_rng(3).permutation(len(corpus.tree))
    layout = BatchLayout(20, 4, block_values(lookahead, nearby=nearby), nearby)
    memory = np.full(layout.size, 255, np.uint8)
    batches = [corpus.batch(rows, Augmentation.none(20)) for rows in (order[:20], order[20:40])]
    for batch in sorted(batches, key=lambda batch: -len(batch.blocks)):
        size, pairs = layout.write(batch, memory)
        padded = layout.read(torch.from_numpy(memory.copy()).to(device), pairs)
        assert size <= layout.size and pairs % 20 == 0
        for found in (padded, PaddedBatch.of(batch, device)):
            parts = [
                model(each, torch.float32) for model, each in zip(models, (TensorBatch.of(batch), found), strict=True)
            ]
            torch.testing.assert_close(parts[1].cpu(), parts[0], atol=1e-5, rtol=0)
            gradients = [
                torch.autograd.grad(part.sum(), model.trained()) for part, model in zip(parts, models, strict=True)
            ]
            for mine, theirs in zip(*gradients, strict=True):
                assert (theirs.cpu() - mine).norm() <= GRADIENTS[device] * mine.norm()


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("nearby", [False, True])
def test_encoders_that_convolve_take_batches_of_one_shape(nearby: bool, device: str) -> None:
    settings = replace(MIXING if nearby else SETTINGS, encoder="conv3d", encoder_width=0)
    corpus, _ = corpus_of(drawn(2), nearby=nearby)
    batch = corpus.batch(np.arange(10), Augmentation.none(10))
    with torch.no_grad(), float32_products(torch.device(device)):
        wanted = Learner(settings).model(TensorBatch.of(batch), torch.float32)
        found = Learner(settings, device=device).model(PaddedBatch.of(batch, device), torch.float32)
    torch.testing.assert_close(found.cpu(), wanted, atol=1e-5, rtol=0)


CREWS = [
    *((ThreadCrew, threads, "cpu") for threads in (2, 3, 50)),
    *((GpuCrew, threads, "cpu") for threads in (1, 3)),
    (GpuCrew, 3, "cuda"),
]


@pytest.mark.parametrize(
    ("settings", "kind", "threads", "device"),
    [
        pytest.param(settings, kind, threads, device, marks=GPU if device == "cuda" else ())
        for settings in (SETTINGS, MIXING)
        for kind, threads, device in CREWS
    ],
)
def test_all_crews_take_the_same_steps(
    datasets: list[Dataset], settings: TrainSettings, kind: type, threads: int, device: str
) -> None:
    corpus, _ = corpus_of(datasets, nearby=settings.kind.mixes)
    plan = StepPlan(corpus, settings, VOXELS, ALONE)
    one = ThreadCrew(Learner(settings), plan, 1)
    other = kind(Learner(settings, device=device), plan, threads)
    try:
        for step in (0, 1, 5, 2) if kind is ThreadCrew else range(3):  # threads gather ahead, whatever is asked for
            (wanted,), errors = one.gradients(step, torch.float32)
            parts, found = other.gradients(step, torch.float32)
            assert kind is not ThreadCrew or len(parts) == min(threads, 4)
            torch.testing.assert_close(found.cpu(), errors, rtol=1e-5, atol=1e-6)
            sizes = [parameter.numel() for parameter in one._learner.model.trained()]
            for mine, theirs in zip(wanted.split(sizes), torch.stack(parts).sum(0).cpu().split(sizes), strict=True):
                assert (theirs - mine).norm() <= GRADIENTS[device] * mine.norm()
    finally:
        one.close()
        other.close()


def test_gathered_ahead_for_another_number_type(datasets: list[Dataset]) -> None:
    """The last steps of a run multiply in float32, whose blocks are not those that were gathered in bfloat16."""
    corpus, _ = corpus_of(datasets)
    plan = StepPlan(corpus, SETTINGS, VOXELS, ALONE)
    ahead, alone = (ThreadCrew(Learner(SETTINGS), plan, 2) for _ in range(2))
    try:
        ahead.gradients(0, torch.bfloat16)
        for mine, wanted in zip(*(crew.gradients(1, torch.float32)[0] for crew in (ahead, alone)), strict=True):
            assert torch.equal(mine, wanted)
    finally:
        ahead.close()
        alone.close()


def test_crew_of_a_device(datasets: list[Dataset]) -> None:
    corpus, _ = corpus_of(datasets)
    crew = crew_for(Learner(SETTINGS), corpus, VOXELS, 3)
    assert isinstance(crew, ThreadCrew) and crew.title == "3 CPU threads"
    crew.close()


def test_steps_depend_on_seed_and_number_alone(datasets: list[Dataset]) -> None:
    corpus, _ = corpus_of(datasets)
    rows, augmentation = plan_of_step(corpus, SETTINGS, VOXELS, 5)
    again, same = plan_of_step(corpus, SETTINGS, VOXELS, 5)
    np.testing.assert_array_equal(rows, again)
    np.testing.assert_array_equal(augmentation.remap, same.remap)
    other = plan_of_step(corpus, replace(SETTINGS, seed=1), VOXELS, 5)
    assert (rows != other[0]).any() and (augmentation.symmetry != other[1].symmetry).any()


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"threads": 1}, {"threads": 3}),
        *(
            pytest.param({"device": a}, {"device": b}, marks=GPU)
            for a, b in (("cpu", "cuda"), ("cuda", "cpu"), ("cuda", "cuda:0"))
        ),
    ],
)
def test_a_run_moves_to_another_device(datasets: list[Dataset], tmp_path: Path, first: dict, second: dict) -> None:
    """Begun on one and resumed on another, it goes as one that stayed on one CPU thread."""
    whole = tmp_path / "whole"
    drain(train(datasets, SETTINGS, RunOptions(whole, log_steps=1, threads=1)))
    moved = tmp_path / "moved"
    drain(train(datasets, SETTINGS, RunOptions(moved, log_steps=1, stop_after=3, **first)))
    weights = drain(train(datasets, SETTINGS, RunOptions(moved, log_steps=1, resume=True, **second)))
    np.testing.assert_allclose(curve(moved), curve(whole), rtol=ERRORS)
    assert len(curve(moved)) == 6 and weights.metadata["steps"] == 6
    assert all(np.isfinite(array).all() for array in weights.arrays().values())


@pytest.mark.parametrize("device", DEVICES)
def test_as_many_threads_go_on_exactly(datasets: list[Dataset], tmp_path: Path, device: str) -> None:
    """On a GPU to rounding: nothing there promises the same order of additions."""
    options = {"log_steps": 1, "threads": 3, "device": device}
    whole = drain(train(datasets, SETTINGS, RunOptions(tmp_path / "a", **options)))
    drain(train(datasets, SETTINGS, RunOptions(tmp_path / "b", stop_after=2, **options)))
    resumed = drain(train(datasets, SETTINGS, RunOptions(tmp_path / "b", resume=True, **options)))
    if device == "cpu":
        assert resumed.hash == whole.hash
    np.testing.assert_allclose(curve(tmp_path / "b"), curve(tmp_path / "a"), rtol=ERRORS)


@gpu_only
@pytest.mark.parametrize("precision", ["tf32", "bf16"])
def test_faster_products_learn_as_well(datasets: list[Dataset], tmp_path: Path, precision: str) -> None:
    settings = replace(SETTINGS, passes=60 * 256)
    for name in ("fp32", precision):
        options = RunOptions(tmp_path / name, log_steps=20, device="cuda")
        drain(train(datasets, replace(settings, precision=name), options))
    np.testing.assert_allclose(curve(tmp_path / precision), curve(tmp_path / "fp32"), rtol=0.15)


def test_types_of_products() -> None:
    assert encoder_type(replace(SETTINGS, precision="auto"), 0.5, "cuda:0") == torch.float32
    assert encoder_type(replace(SETTINGS, precision="tf32"), 0.5, "cuda:0") == torch.float32
    for device in ("cpu", "cuda:0"):
        assert encoder_type(replace(SETTINGS, precision="bf16"), 0.5, device) == torch.bfloat16
    with pytest.raises(SettingError, match="Precision 'fp8' is unknown: use one of auto, bf16, fp32, tf32"):
        replace(SETTINGS, precision="fp8")


def test_device_and_threads_of_the_command(
    datasets: list[Dataset], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    save_octree(datasets[0].octree, tmp_path / "a.safetensors")
    path = tmp_path / "a.samples.safetensors"
    save_samples(datasets[0].samples, tmp_path / "a.safetensors", datasets[0].octree, SampleSettings(), path)
    words = ["lab", "train", str(path), "--batch", "256", "--passes", "512", "--out", str(tmp_path / "run")]
    for device, sentence in (("gpu", "--device 'gpu' is unknown: choose auto"), ("cuda:777", "--device 'cuda:777'")):
        assert main([*words, "--device", device]) == 2
        assert sentence in capsys.readouterr().err
    assert main([*words, "--threads", "0"]) == 2
    assert "--threads 0 is outside 1 to" in capsys.readouterr().err
    assert main([*words, "--device", "cpu", "--threads", "3"]) == 0
    assert main([*words[:-1], str(tmp_path / "again"), "--device", "cpu", "--threads", "1"]) == 0
    np.testing.assert_allclose(curve(tmp_path / "run"), curve(tmp_path / "again"), rtol=ERRORS)


@pytest.mark.parametrize("device", DEVICES)
def test_benchmark_of_a_device(device: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_bench, "BATCHES", {128: 2})
    words = ["bench", "device", "--device", device, "--nodes", "3000", "--corners", "100"]
    words += ["--samples", "400", "--repeats", "2", "--threads", "2"]
    assert main([*words, "--json"]) == 0
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (values["name"], values["unit"]) == ("device", "codes per second")
    assert values["ratio"] == pytest.approx(values["ours"] / values["peer"])
    names = [row["what"] for row in values["measured"]]
    assert len(set(names)) == len(names) and {"codes/s", "samples/s"} == {row["unit"] for row in values["measured"]}
    assert all(row["device"] > 0 and row["cpu"] > 0 and len(row["cpu_runs"]) >= 2 for row in values["measured"])
    apart = values["differences"]
    assert apart["codes"] <= 1e-4 + 1e-5 * apart["largest_code"]
    assert {apart[f"errors of a step, {kind}, fp32"] <= 1e-5 for kind in ("mixture", "paper")} == {True}
    assert main(words) == 0
    assert "| codes, whole octree |" in capsys.readouterr().out


def test_benchmark_of_a_device_that_is_not_there(capsys: pytest.CaptureFixture) -> None:
    assert main(["bench", "device", "--device", "cuda:777"]) == 2
    assert "--device 'cuda:777'" in capsys.readouterr().err
