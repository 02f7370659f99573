# SPDX-License-Identifier: GPL-3.0-or-later
"""Benches of `patchnet bench`, one a file; `commands/bench.py` has their arguments and imports the one that runs."""
