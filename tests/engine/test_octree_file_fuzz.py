# SPDX-License-Identifier: GPL-3.0-or-later
"""The octree reader against damaged, foreign and contradictory files, and saving against kills."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from patchnet.patchnet_addon.octree.file import KIND, load_octree, octree_arrays, save_octree
from patchnet.patchnet_addon.runtime.errors import OctreeFileError
from patchnet.patchnet_addon.runtime.files import read_arrays, read_header, write_arrays
from patchnet.tests.engine.octree_samples import octree_from_leaves

fuzz = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module", autouse=True)
def unsynchronized():
    """Hundreds of files, of which none need outlive a power cut."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(scope="module")
def octree():
    rng = np.random.default_rng(0)
    cells = {tuple(cell) for cell in rng.integers(0, 8, (40, 3)).tolist()}
    gray = octree_from_leaves({(3, cell): (rng.uniform(0.1, 1), rng.random(), (0, 0, 1)) for cell in cells}, 3)
    return replace(gray, chroma=rng.integers(0, 128, (gray.node_count, 2)).astype(np.uint8))


def refused(path):
    """Ask the reader whether it refuses a file, with a sentence that names it."""
    try:
        loaded = load_octree(path)
    except OctreeFileError as caught:
        assert str(path) in str(caught) and "\n" not in str(caught)
        return None
    return loaded


def walk(octree):
    """Visits of every node on a walk from the root, and the largest level."""
    seen = np.zeros(octree.node_count, int)
    front, level = [0], 0
    while front:
        children = []
        for node in front:
            seen[node] += 1
            assert octree.level_start[level] <= node < octree.level_start[level + 1]
            first = int(octree.first_child[node])
            children += range(first, first + int(octree.child_mask[node]).bit_count())
        front, level = children, level + 1
        assert level <= octree.depth + 1
    return seen


@fuzz
@given(data=st.data())
def test_contradictory_files_are_refused_or_can_be_walked(octree, tmp_path, data):
    """Files with right checksums whose values were changed: what is accepted is a tree, every node of it once."""
    arrays = {name: array.copy() for name, array in octree_arrays(octree).items()}
    for _ in range(data.draw(st.integers(1, 3))):
        name = data.draw(st.sampled_from(sorted(arrays)))
        flat = arrays[name].reshape(-1)
        change = data.draw(st.sampled_from(["value", "length", "type", "shape", "special"]))
        if change == "value" and len(flat) and flat.dtype.kind in "ui":
            limits = np.iinfo(flat.dtype)
            flat[data.draw(st.integers(0, len(flat) - 1))] = data.draw(st.integers(int(limits.min), int(limits.max)))
        elif change == "length":
            arrays[name] = arrays[name][: data.draw(st.integers(0, len(arrays[name])))]
        elif change == "type":
            with np.errstate(invalid="ignore"):
                arrays[name] = arrays[name].astype(data.draw(st.sampled_from([np.uint8, np.int64, np.float32])))
        elif change == "shape":
            arrays[name] = arrays[name].reshape(
                data.draw(st.sampled_from([(flat.size, 1), (1, flat.size), (flat.size,)]))
            )
        elif flat.dtype.kind == "f" and len(flat):
            flat[data.draw(st.integers(0, len(flat) - 1))] = data.draw(st.sampled_from([np.nan, np.inf, -1.0]))
    path = tmp_path / "odd.safetensors"
    write_arrays(path, arrays, read_metadata(octree, tmp_path), KIND)
    loaded = refused(path)
    if loaded is not None:
        assert (walk(loaded) == 1).all()
        assert np.isfinite(loaded.area_world).all()
        assert np.isfinite(loaded.color_float(slice(None))).all()


def read_metadata(octree, folder):
    path = folder / "good.safetensors"
    if not path.exists():
        save_octree(octree, path)
    return read_header(path).metadata


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=5,
)


@fuzz
@given(
    st.sampled_from(["origin_world", "side_world", "depth", "exposure", "provenance", None]),
    json_values,
)
def test_odd_metadata_are_refused_or_make_sense(octree, tmp_path, name, value):
    metadata = read_metadata(octree, tmp_path)
    changed = value if name is None else {**metadata, name: value}
    path = tmp_path / "meta.safetensors"
    write_arrays(path, octree_arrays(octree), changed, KIND)
    loaded = refused(path)
    if loaded is not None:
        assert loaded.depth == 3
        assert loaded.grid.side_world > 0 and np.isfinite(loaded.grid.origin_world).all()


WRITER = """
import sys
import numpy as np
from patchnet.patchnet_addon.runtime.files import write_arrays
print("ready", flush=True)
for number in range(1, 100_000):
    write_arrays(sys.argv[1], {"values": np.full(1_000_000, number)}, {"number": number}, "octree")
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")
def test_killed_while_saving_leaves_a_whole_file(tmp_path):
    """Kills at random moments of endless saving: the file always is one that was written whole."""
    path = tmp_path / "o.safetensors"
    write_arrays(path, {"values": np.zeros(1_000_000, np.int64)}, {"number": 0}, KIND)
    random = np.random.default_rng(int.from_bytes(os.urandom(4)))
    interrupted = 0
    for _ in range(8):
        writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
        assert writer.stdout is not None and writer.stdout.readline() == b"ready\n"
        time.sleep(random.uniform(0.0, 0.2))
        writer.kill()
        writer.wait()
        writer.stdout.close()
        arrays, metadata = read_arrays(path, KIND, OctreeFileError)
        assert (arrays["values"] == metadata["number"]).all()
        for leftover in tmp_path.glob(".*.tmp"):
            interrupted += 1
            leftover.unlink()
    assert interrupted > 0, "no kill met a file that was being written"
