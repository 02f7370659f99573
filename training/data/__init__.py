# SPDX-License-Identifier: GPL-3.0-or-later
"""Training samples, their octrees, and batches."""
