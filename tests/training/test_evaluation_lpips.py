# SPDX-License-Identifier: GPL-3.0-or-later
"""LPIPS with random weights against a plain computation (methods 5)."""

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from torch.nn import functional  # noqa: E402

from patchnet.patchnet_addon.runtime.errors import WeightsFileError  # noqa: E402
from patchnet.tests.training.frame_samples import random_frame, scores_of  # noqa: E402
from patchnet.training.evaluation.curves import frame_orders  # noqa: E402
from patchnet.training.evaluation.lpips import LpipsWeights, lpips  # noqa: E402
from patchnet.training.evaluation.picture_metrics import QUALITY_NAMES, composed_pictures, picture_metrics  # noqa: E402

SHAPES = {0: (64, 3, 11, 11), 3: (192, 64, 5, 5), 6: (384, 192, 3, 3), 8: (256, 384, 3, 3), 10: (256, 256, 3, 3)}


@pytest.fixture(scope="module")
def states() -> tuple[dict, dict]:
    """State dicts of random weights under the names of the public files; classifiers are there and not read."""
    make = torch.Generator().manual_seed(5)
    trunk = {"classifier.1.weight": torch.zeros(4, 4)}
    heads = {}
    for layer, (number, shape) in enumerate(SHAPES.items()):
        fan_in = shape[1] * shape[2] * shape[3]
        trunk[f"features.{number}.weight"] = torch.randn(shape, generator=make) * (2 / fan_in) ** 0.5
        trunk[f"features.{number}.bias"] = torch.randn(shape[0], generator=make) * 0.1
        heads[f"lin{layer}.model.1.weight"] = torch.rand((1, shape[0], 1, 1), generator=make)
    return trunk, heads


@pytest.fixture
def files(states: tuple[dict, dict], tmp_path: Path) -> tuple[Path, Path]:
    paths = tmp_path / "alexnet.pth", tmp_path / "heads.pth"
    for state, path in zip(states, paths, strict=True):
        torch.save(state, path)
    return paths


def plain_lpips(states: tuple[dict, dict], picture: np.ndarray, reference: np.ndarray) -> float:
    """LPIPS of two gray pictures in float64, written out layer by layer."""
    trunk, heads = ({name: value.double() for name, value in state.items()} for state in states)

    def features(gray: np.ndarray) -> list[torch.Tensor]:
        rgb = torch.from_numpy(np.stack([gray] * 3))[None].double() * 2 - 1
        mean = torch.tensor([-0.030, -0.088, -0.188], dtype=torch.float64).view(1, 3, 1, 1)
        deviation = torch.tensor([0.458, 0.448, 0.450], dtype=torch.float64).view(1, 3, 1, 1)
        x = (rgb - mean) / deviation
        first = functional.conv2d(x, trunk["features.0.weight"], trunk["features.0.bias"], stride=4, padding=2).relu()
        x = functional.max_pool2d(first, kernel_size=3, stride=2)
        second = functional.conv2d(x, trunk["features.3.weight"], trunk["features.3.bias"], padding=2).relu()
        x = functional.max_pool2d(second, kernel_size=3, stride=2)
        third = functional.conv2d(x, trunk["features.6.weight"], trunk["features.6.bias"], padding=1).relu()
        fourth = functional.conv2d(third, trunk["features.8.weight"], trunk["features.8.bias"], padding=1).relu()
        fifth = functional.conv2d(fourth, trunk["features.10.weight"], trunk["features.10.bias"], padding=1).relu()
        return [first, second, third, fourth, fifth]

    total = 0.0
    for layer, (mine, its) in enumerate(zip(features(picture), features(reference), strict=True)):
        unit = [each / (torch.sqrt((each**2).sum(1, keepdim=True)) + 1e-10) for each in (mine, its)]
        total += float(functional.conv2d((unit[0] - unit[1]) ** 2, heads[f"lin{layer}.model.1.weight"]).mean())
    return total


def test_lpips_is_that_of_a_plain_computation(states: tuple[dict, dict], files: tuple[Path, Path]) -> None:
    rng = np.random.default_rng(0)
    reference = rng.random((70, 66))
    pictures = np.clip(reference + rng.normal(0, 0.2, (18, 70, 66)) * np.linspace(0, 1, 18)[:, None, None], 0, 1)
    found = lpips(LpipsWeights.load(*files), pictures, reference)
    assert found.shape == (18,) and found.dtype == np.float64 and found[0] == pytest.approx(0, abs=1e-9)
    expected = [plain_lpips(states, pictures[number], reference) for number in (1, 9, 17)]
    np.testing.assert_allclose(found[[1, 9, 17]], expected, rtol=2e-4)
    assert found[17] > found[9] > found[1] > 0
    assert lpips(LpipsWeights.load(*files), pictures[:0], reference).shape == (0,)


def test_picture_metrics_have_it(states: tuple[dict, dict], files: tuple[Path, Path]) -> None:
    buffers = random_frame(1, 40, 40)
    order = frame_orders(buffers, scores_of(buffers))["random"]
    found = picture_metrics(buffers, composed_pictures(buffers, order, [0.0, 0.5]), LpipsWeights.load(*files))
    expected = plain_lpips(states, buffers.preview.reshape(40, 40), buffers.reference.reshape(40, 40))
    linear, srgb = (found[:, QUALITY_NAMES.index(f"lpips {name}")] for name in ("linear", "srgb"))
    assert linear[0] == pytest.approx(expected, rel=2e-4) and srgb[0] != pytest.approx(expected, rel=1e-2)
    assert np.isfinite([linear, srgb]).all()


def test_wrong_files_are_named(states: tuple[dict, dict], files: tuple[Path, Path], tmp_path: Path) -> None:
    trunk_path, heads_path = files
    wrong = tmp_path / "wrong.pth"
    with pytest.raises(WeightsFileError, match=r"heads\.pth has no finite 'features\.0\.weight'"):
        LpipsWeights.load(heads_path, trunk_path)
    for content in (None, b"", b"no weights at all", files[0].read_bytes()[:5000]):
        if content is not None:
            wrong.write_bytes(content)
        with pytest.raises(WeightsFileError, match=r"wrong\.pth cannot be read"):
            LpipsWeights.load(wrong, heads_path)
    for value in (torch.ones(3), torch.full((1, 384, 1, 1), torch.nan), 3):
        torch.save(states[1] | {"lin2.model.1.weight": value}, wrong)
        with pytest.raises(WeightsFileError, match=r"wrong\.pth has no finite 'lin2"):
            LpipsWeights.load(trunk_path, wrong)
    torch.save([1, 2], wrong)
    with pytest.raises(WeightsFileError, match="no finite"):
        LpipsWeights.load(wrong, heads_path)


def test_files_that_run_code_are_refused(files: tuple[Path, Path], tmp_path: Path) -> None:
    class Print:
        def __reduce__(self):
            return print, ("executed",)

    torch.save({"features.0.weight": Print()}, tmp_path / "code.pth")
    with pytest.raises(WeightsFileError, match="cannot be read"):
        LpipsWeights.load(tmp_path / "code.pth", files[1])
