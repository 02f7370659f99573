# SPDX-License-Identifier: GPL-3.0-or-later
"""The error estimator: kernel against reference, planes, features, files, strategies."""

from dataclasses import replace

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.network.weights import Weights, load_weights, save_weights
from patchnet.patchnet_addon.runtime.errors import SettingError, WeightsFileError
from patchnet.patchnet_addon.runtime.files import read_arrays, write_arrays
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.patchnet_plus import NEEDS, estimators_warning
from patchnet.patchnet_addon.sampling.plus.features import features_of, windows_of
from patchnet.patchnet_addon.sampling.plus.forms import CENTRE, FAR, FORMS, Kind, Plane
from patchnet.patchnet_addon.sampling.plus.weights import (
    KIND,
    Estimators,
    estimators_of,
    load_estimators,
    save_estimators,
    shipped_estimators,
    with_estimators,
)
from patchnet.patchnet_addon.sampling.plus_planes import estimated_error, view_planes
from patchnet.patchnet_addon.sampling.predicted import PREDICTED
from patchnet.patchnet_addon.sampling.registry import DEFAULT, STRATEGIES
from patchnet.patchnet_addon.sampling.strategy import Strategy
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.tests.references.small import estimate_reference, random_estimators
from patchnet.training.strategies.registry import EVALUATED

ALL = Strategy("all", "All", "All that estimators see", NEEDS, lambda buffers: buffers.preview, "luminance", 1.0)
PLUS = ("patchnet-plus", "patchnet-plus-1", "patchnet-plus-0", "plain-plus-4", "plain-plus-1", "plain-plus-0")
EYE = np.array([2.1, 1.4, 1.2])


@pytest.fixture(scope="module")
def coded():
    return drain(encode_octree(random_octree(depth=7, count=400), Weights.random(seed=3)))


@pytest.fixture(scope="module")
def estimators():
    return random_estimators(seed=5)


def view(coded, size_px=(75, 40), needs=ALL, **settings):
    camera = Camera.look_at(EYE, np.full(3, 0.5), size_px=size_px)
    return drain(trace_view(coded.octree, camera, [needs], coded=coded, reference=False, **settings))


def reference(buffers, estimators, form):
    return estimate_reference(view_planes(buffers, form.planes), estimators, form)


@pytest.fixture(scope="module")
def buffers(coded):
    return view(coded)


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("size_px", [(1, 1), (3, 2), (63, 5), (64, 4), (65, 3), (130, 20)])
def test_kernel_is_the_reference(name, size_px, coded, estimators):
    """Sums of the layers are rounded otherwise, each to about 1e-7."""
    seen = view(coded, size_px)
    found, expected = estimated_error(seen, estimators, FORMS[name]), reference(seen, estimators, FORMS[name])
    np.testing.assert_allclose(found[seen.active], expected[seen.active], rtol=1e-5, atol=1e-7)
    assert (found[~seen.active] == 0).all() and found.dtype == np.float32


def test_planes_and_their_border(buffers):
    planes = view_planes(buffers, tuple(Plane))
    assert planes.shape == (len(Plane), buffers.height + 2, buffers.width + 2)
    luminance = planes[Plane.LUMINANCE]
    np.testing.assert_array_equal(luminance, np.pad(buffers.picture(buffers.preview), 1, mode="edge"))
    inside = planes[:, 1:-1, 1:-1].reshape(len(Plane), -1)
    np.testing.assert_array_equal(inside[Plane.RAY_2], buffers.fine_rays[:, 2])
    np.testing.assert_array_equal(inside[Plane.DEPTH] == FAR, ~buffers.hit)
    np.testing.assert_array_equal(view_planes(buffers, tuple(Plane), 9, 17), planes[:, 9:19])
    children = np.array([int(mask).bit_count() / 8 for mask in buffers.child_mask])
    np.testing.assert_array_equal(inside[Plane.CHILDREN], children)
    assert 0 < buffers.scene_luminance < 1
    alone = replace(buffers, behind=np.full_like(buffers.preview, buffers.scene_luminance))
    np.testing.assert_allclose(inside[Plane.OPEN], alone.predicted, atol=1e-6)


def test_features_by_hand(buffers):
    form = FORMS["plus-4"]
    windows = windows_of(view_planes(buffers, form.planes))
    values, scale = features_of(windows, form)
    assert values.shape == (len(form.features), buffers.width * buffers.height)
    pixel = int(np.flatnonzero(buffers.hit)[len(buffers.hit[buffers.hit]) // 2])
    plane = {one: windows[number, :, pixel].astype(np.float64) for number, one in enumerate(form.planes)}
    squares = 1e-5
    for feature in form.features:
        if feature.kind == Kind.DIFFERENCE:
            squares += feature.share * (plane[feature.plane][feature.place] - plane[Plane.LUMINANCE][CENTRE]) ** 2
    assert scale[pixel] == pytest.approx(squares, rel=1e-5)
    for row, feature in enumerate(form.features):
        there, here = plane[feature.plane][feature.place], plane[feature.plane][CENTRE]
        slope = (there - here) * plane[Plane.PER_PIXEL][CENTRE]
        normals = [plane[Plane(Plane.NORMAL_X + axis)] for axis in range(3)]
        expected = {
            Kind.VALUE: there,
            Kind.DIFFERENCE: (there - plane[Plane.LUMINANCE][CENTRE]) / squares**0.5,
            Kind.SLOPE: slope / (1 + abs(slope)),
            Kind.ANGLE: sum(normal[feature.place] * normal[CENTRE] for normal in normals),
            Kind.SCALE: np.log(squares),
        }[feature.kind]
        assert values[row, pixel] == pytest.approx(expected, rel=1e-3, abs=1e-4)


def test_file_is_read_as_it_was_written(estimators, tmp_path):
    path = tmp_path / "plus.safetensors"
    save_estimators(replace(estimators, metadata={"seed": 5}), path)
    read = load_estimators(path)
    assert read.hash == estimators.hash and read.metadata == {"seed": 5}


def test_shipped_estimators_are_of_these_features():
    assert shipped_estimators().networks.keys() == FORMS.keys()
    assert {"command", "octrees", "patchnet", "seed", "steps"} <= shipped_estimators().metadata.keys()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda arrays, notes: arrays.pop("plus-1.skip"), "lacks 'plus-1.skip'"),
        (lambda arrays, notes: arrays.update({"plus-1.skip": np.zeros(3, np.float32)}), r"float32 of shape \(3,\)"),
        (lambda arrays, notes: arrays["plain-0.0.bias"].fill(np.nan), "not finite"),
        (lambda arrays, notes: notes["features"].update({"plus-4": "other"}), "other features of 'plus-4'.*train-plus"),
        (lambda arrays, notes: notes.clear(), "other features"),
    ],
)
def test_other_files_are_refused(change, message, estimators, tmp_path):
    path = tmp_path / "plus.safetensors"
    save_estimators(estimators, path)
    arrays, notes = read_arrays(path, KIND)
    arrays = {name: np.array(array) for name, array in arrays.items()}
    change(arrays, notes)
    write_arrays(path, arrays, notes, KIND)
    with pytest.raises(WeightsFileError, match=message):
        load_estimators(path)


def test_strategies_score_what_they_say(coded):
    assert PLUS[0] == DEFAULT and list(STRATEGIES)[:3] == list(PLUS[:3])
    for name, form in zip(PLUS, ("plus-4", "plus-1", "plus-0", "plain-4", "plain-1", "plain-0"), strict=True):
        strategy = EVALUATED[name]
        seen = view(coded, (30, 20), strategy)  # with its own needs and nothing else
        np.testing.assert_array_equal(strategy.scores(seen), estimated_error(seen, shipped_estimators(), FORMS[form]))
        assert strategy.extra_rays == {0: 0, 1: 1, 4: 5}[FORMS[form].rays]  # one of five goes on behind
    with pytest.raises(SettingError, match="needs the view's child_mask, normal"):
        EVALUATED["plain-plus-0"].scores(replace(seen, child_mask=None, normal=None))


def test_predicted_picture_has_estimates_of_its_own(coded):
    for name, form in (("patchnet-plus", "predicted-4"), ("patchnet-plus-1", "predicted-1")):
        seen = view(coded, (30, 20), STRATEGIES[name], unrefined=PREDICTED)
        found = STRATEGIES[name].scores(seen)
        np.testing.assert_array_equal(found, estimated_error(seen, shipped_estimators(), FORMS[form]))


def test_estimators_belong_to_weights():
    learned = shipped_estimators().metadata["patchnet"]
    assert learned == load_weights().hash, "train the estimators anew after the weights: training/shipped_weights.sh"
    other = Weights.random()
    assert estimators_warning(DEFAULT, load_weights()) is None and estimators_warning("patchnet", other) is None
    warning = estimators_warning("patchnet-plus-0", other)
    assert warning is not None and "train-plus" in warning and learned in warning


def test_estimators_travel_in_the_weights_file(coded, tmp_path):
    """They rank where the file is used; codes do not depend on them, frames of an animation do."""
    estimators = Estimators(random_estimators(1).networks, {"patchnet": coded.weights.hash})
    save_weights(with_estimators(coded.weights, estimators), tmp_path / "both.safetensors")
    read = load_weights(tmp_path / "both.safetensors")
    assert read.hash == coded.weights.hash and read.whole_hash != read.hash == coded.weights.whole_hash
    assert estimators_of(read).hash == estimators.hash and estimators_of(coded.weights) is shipped_estimators()
    assert estimators_warning("patchnet-plus", read) is None
    plain, own = view(coded, (30, 20)), view(replace(coded, weights=read), (30, 20))
    for name, form in (("patchnet-plus", "plus-4"), ("patchnet-plus-0", "plus-0")):
        found = STRATEGIES[name].scores(own)
        np.testing.assert_array_equal(found, estimated_error(plain, estimators, FORMS[form]))
        assert not np.array_equal(found, STRATEGIES[name].scores(plain))
