# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimator of each pixel's squared error from all its inputs (methods 12)."""
