# SPDX-License-Identifier: GPL-3.0-or-later
"""Benches of `patchnet bench`, one a file; `commands/bench.py` documents what such a file holds."""
