# SPDX-License-Identifier: GPL-3.0-or-later
"""Benches of `patchnet bench`, one per file; `bench.py` has their arguments."""
