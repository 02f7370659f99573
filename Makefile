# PatchNet for Blender: `make demo` and `make test` work on a bare Debian 12 with Python 3.11.
#
#   make demo     install what is missing, then build, bake, encode and refine the demo scene into out/demo
#   make test     lint, types and all tests: about 15 minutes on two cores
#   make lint     lint and types only
#   make test-blender   the extension in a real Blender 5.2, with a window: BLENDER=/path/to/blender, or one is fetched
#   make docs     the site of the documentation into out/docs; runs its tutorial in Blender
#   make zip      the extension with its wheels into dist/: a zip for each platform and Python
#   make zip-platform   one zip per platform with the wheels of Blender 4.5 to 5.3, for extensions.blender.org
#   make clean    remove results and builds, keep the environments
#
# PYTHON=/path/to/python3.11 chooses the interpreter.

SHELL := /bin/bash
export PYTHON PYTHON_NEWEST
VENV := .venv
STAMP := $(VENV)/.installed
VENV_NEWEST := .venv-newest
STAMP_NEWEST := $(VENV_NEWEST)/.installed
VENV_DOCS := .venv-docs
STAMP_DOCS := $(VENV_DOCS)/.installed
INPUTS := pyproject.toml setup.py constraints.txt

.PHONY: demo test test-blender lint docs zip zip-platform clean system environment environment-newest environment-docs

demo: environment
	$(VENV)/bin/patchnet demo --reference --out out/demo

test: environment
	.ci/test $(VENV)/bin/python

# By default this creates a small Debian with Blender in .blender-root (1.1 GB, as root) or in BLENDER_ROOT.
test-blender: environment
	.ci/pytest-group $(VENV)/bin/python "real Blender" tests/real_blender

lint: environment
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy

# Every build reads all pages and runs the tutorial; it fails on a warning such as a broken link.
docs: environment-docs
	$(VENV_DOCS)/bin/sphinx-build --fail-on-warning --keep-going --fresh-env -d out/docs-build docs out/docs
	@echo "the site is in out/docs: open out/docs/index.html"

zip: environment
	$(VENV)/bin/python .ci/build_extension.py --out dist --wheels all --platform all

zip-platform: environment
	$(VENV)/bin/python .ci/build_extension.py --out dist --wheels 3.11 3.13 --together --platform all

clean:
	rm -rf out dist build *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find . -name __pycache__ -not -path './.venv*' -prune -exec rm -rf {} +

environment: $(STAMP)
environment-newest: $(STAMP_NEWEST)
environment-docs: $(STAMP_DOCS)

# Blender's libraries and Python's venv: checked every time, installed if missing.
system:
	@.ci/system-libraries

$(STAMP): $(INPUTS) | system
	.ci/make-environment 3.11 $(VENV) "blender,train,bench,test"

# The newest Blender, 5.3, has Python 3.13. Without torch, as for most Blender users.
$(STAMP_NEWEST): $(INPUTS) | system
	.ci/make-environment 3.13 $(VENV_NEWEST) "blender,test"

# Sphinx's requirements are for the documentation only.
$(STAMP_DOCS): $(INPUTS) | system
	.ci/make-environment 3.11 $(VENV_DOCS) "blender,docs"
