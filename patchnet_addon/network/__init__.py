# SPDX-License-Identifier: GPL-3.0-or-later
"""PatchNet in torch and without it, harmonics, weights."""
