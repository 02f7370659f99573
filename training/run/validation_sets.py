# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation sets of a run: scenes that take no part in it, and held-out parts of those that do (methods 7.21)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...patchnet_addon.runtime.errors import SettingError
from ..data.corpus import Corpus
from ..data.dataset import Dataset, check_names
from ..data.forest import concatenate
from ..data.held_out import why_not_held_out


@dataclass(frozen=True, eq=False)
class ValidationSet:
    """Voxels to validate on; not_held_out: why errors on them are not those of an unseen scene, empty if they are."""

    corpus: Corpus
    not_held_out: str


def validation_sets(
    parts: Mapping[str, Corpus],
    training: Sequence[Dataset],
    validation: Sequence[Dataset],
    lookahead: int,
    *,
    nearby: bool = False,
) -> dict[str, ValidationSet]:
    """Validation sets by name: all of `validation`, then the held-out `parts` of `training` by data set.

    nearby: as `Corpus` says. Raises SettingError for names that are there twice, and for another look-ahead than that
    of training.
    """
    check_names(dataset.name for dataset in (*training, *validation))
    sets = {}
    for dataset in validation:
        if dataset.lookahead != lookahead:
            raise SettingError(
                f"{dataset.name} looks {dataset.lookahead} levels ahead, training {lookahead}: draw it with the same"
            )
        sets[dataset.name] = ValidationSet(all_of(dataset, nearby=nearby), why_not_held_out(dataset, training))
    reasons = {dataset.name: why_not_held_out(dataset, training) for dataset in training}
    return sets | {name: ValidationSet(corpus, reasons[name]) for name, corpus in parts.items()}


def all_of(dataset: Dataset, *, nearby: bool = False) -> Corpus:
    """All samples of a data set, held out or not; nearby: as `Corpus` says."""
    samples = dataset.samples
    tree = np.zeros(len(samples.voxel), np.int32)
    return Corpus(concatenate([dataset.octree]), tree, samples.voxel, samples.views, dataset.lookahead, nearby)
