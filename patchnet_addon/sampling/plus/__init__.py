# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimator of each pixel's squared error, of everything that is known of it (methods 12)."""
