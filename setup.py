# SPDX-License-Identifier: GPL-3.0-or-later
"""Package discovery of the build; pyproject.toml has all other build settings.

The repository root is the package `patchnet`. setuptools can map that (`package-dir`) but cannot discover the
sub-packages under the mapped name, and a hand-written list silently omits new folders from the wheel.
"""

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

PARTS = ("patchnet_addon", "operators", "training", "commands")
DATA = [
    "**/*.safetensors",
    "**/*.md",
    "**/*.json",
    "**/*.toml",
    "**/*.sh",
    "**/*.glsl",
    "**/*.png",
    "ui/presets/**/*.py",
]


class BuildTree(build_py):
    """Build step that copies the modules of each package, except this script."""

    def find_package_modules(self, package: str, package_dir: str) -> list[tuple[str, str, str]]:
        return [module for module in super().find_package_modules(package, package_dir) if module[1] != "setup"]


found = find_packages(include=[pattern for part in PARTS for pattern in (part, f"{part}.*")])
setup(
    packages=["patchnet", *(f"patchnet.{name}" for name in sorted(found))],
    package_data={"patchnet": ["blender_manifest.toml"], **{f"patchnet.{part}": DATA for part in PARTS}},
    cmdclass={"build_py": BuildTree},
)
