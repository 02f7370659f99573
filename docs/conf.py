# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of Sphinx, which makes the site of these pages: `make docs` writes it to out/docs.

The pages are Markdown that GitHub shows as well, read by MyST; first-scene.md is run while the site is built (MyST-NB),
so that each of its pictures comes from the code beside it. `site/repository_links.py` has what links to files outside
of this folder become.
"""

import os
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs" / "site"))

project = "PatchNet for Blender"
author = copyright = "PatchNet maintainers"
release = version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]

extensions = ["myst_nb", "repository_links"]
source_suffix = {".md": "myst-nb"}
exclude_patterns = ["site", "openjd", "slurm", "flamenco"]
myst_enable_extensions = ["html_image"]
myst_heading_anchors = 4
smartquotes = False  # two hyphens of an argument stay two hyphens

# The page that runs needs Blender as a module, and pictures and compiled kernels that are as in any other job.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 900
nb_merge_streams = True
os.environ.setdefault("PATCHNET_LOG", "text")

html_theme = "furo"
html_title = f"{project} {release}"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"source_directory": "docs/", "navigation_with_keys": True}
pygments_style = "friendly"
pygments_dark_style = "github-dark"
