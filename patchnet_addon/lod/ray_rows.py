# SPDX-License-Identifier: GPL-3.0-or-later
"""Which rows of a picture have rays when a job has many cameras."""

_WHOLE_PICTURES = 25  # least number of pictures of rays that the cameras of a track have together
_FARTHEST = 10  # rows of tiles from one with rays to the next, at most


def rows_apart(cameras: int) -> int:
    """Rows of tiles from one with rays to the next, in each picture of a job's cameras."""
    return min(max(cameras // _WHOLE_PICTURES, 1), _FARTHEST)
