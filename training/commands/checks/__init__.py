# SPDX-License-Identifier: GPL-3.0-or-later
"""Random scenes of `patchnet check-scenes`: their maker, and the judge of their light."""
