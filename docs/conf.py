# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of Sphinx, which builds the site of these pages: `make docs` writes it to out/docs.

MyST reads the pages, which are Markdown for GitHub as well. MyST-NB runs first-scene.md while the site is built, so
that each of its pictures comes from the code beside it. `site/repository_links.py` converts links to files outside this
folder.
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
exclude_patterns = ["site", "openjd"]
myst_enable_extensions = ["html_image"]
myst_heading_anchors = 4
smartquotes = False  # keeps the two hyphens of arguments

# first-scene.md needs Blender as a module, and time to compile kernels.
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
