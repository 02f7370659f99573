# SPDX-License-Identifier: GPL-3.0-or-later
"""Source hashes cover all imported modules."""

import subprocess
import sys
from pathlib import Path

import pytest

from patchnet.patchnet_addon.runtime.source_hash import dependencies, source_hash

ROOT = Path(__file__).resolve().parents[2]
LOADED = """
import importlib, sys
importlib.import_module("patchnet." + sys.argv[1])
print(*(module.__file__ for name, module in sys.modules.items() if name.startswith("patchnet.") and module.__file__))
"""


@pytest.mark.parametrize(
    "module", ["patchnet_addon.light.surface_light", "patchnet_addon.codes.encode", "patchnet_addon.sampling.registry"]
)
def test_everything_that_is_loaded_counts(module: str) -> None:
    done = subprocess.run([sys.executable, "-c", LOADED, module], capture_output=True, text=True, check=True)
    loaded = {Path(path) for path in done.stdout.split()}
    assert len(loaded) > 5
    assert loaded - {ROOT / "__init__.py"} <= dependencies([module])


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A package of four modules: baker imports texels and, within a function, margins; panel imports baker."""
    files = {
        "light/__init__.py": "",
        "light/baker.py": "from .texels import SIZE\n\ndef bake():\n    from .. import margins\n",
        "light/texels.py": "from __future__ import annotations\nSIZE = 2\n",
        "margins.py": "MARGIN = 1\n",
        "panel.py": "from .light.baker import (\n    bake,\n)\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize("changed", ["light/baker.py", "light/texels.py", "margins.py", "light/__init__.py"])
def test_a_change_of_what_is_imported_changes_the_hash(tree: Path, changed: str) -> None:
    before = source_hash("light.baker", root=tree)
    (tree / changed).write_text((tree / changed).read_text() + "# changed\n")
    assert source_hash("light.baker", root=tree) != before


def test_what_is_not_imported_does_not_count(tree: Path) -> None:
    before = source_hash("light.baker", root=tree)
    (tree / "panel.py").write_text("")
    assert source_hash("light.baker", root=tree) == before and source_hash("panel", root=tree) != before
