# SPDX-License-Identifier: GPL-3.0-or-later
"""What `patchnet bench` measures, one bench a file; `commands/bench.py` says what a file holds."""
