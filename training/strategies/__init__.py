# SPDX-License-Identifier: GPL-3.0-or-later
"""Reference strategies of the literature without training, PatchNet's rivals in research."""
