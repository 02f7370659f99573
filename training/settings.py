# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a training run and the presets of the command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ..patchnet_addon.network.encoders import MLP, MLP_WIDTH_STEP, EncoderKind
from ..patchnet_addon.network.kinds import KINDS, MIXTURE, WIDTH_STEP, NetworkKind
from ..patchnet_addon.network.kinds import PAPER as PAPER_KIND
from ..patchnet_addon.runtime import bounds
from ..patchnet_addon.runtime.errors import SettingError
from .encoders import ENCODERS, ConvolvingKind

SAMPLES = 16_000_000  # of all data sets, as in the paper and for the shipped weights
VIEWS = 8  # of each voxel
VALIDATION_VOXELS = 2048  # most of a data set
SCHEDULES = ("paper", "cosine")
ABSOLUTE, SQUARED = LOSSES = ("absolute", "squared")
AUTO, BF16, FP32, TF32 = PRECISIONS = ("auto", "bf16", "fp32", "tf32")
_HIGHEST_RATE = 0.016
OF_LENGTH = "passes", "learning_rate", "warm_up"  # settings that may change when a run is extended
_WARM_UP_SHARE = 0.1  # longest warm-up, as a share of a run
QUICK_SAMPLES = SAMPLES // 4
SHIPPED_PASSES, SHIPPED_WIDTH = 256_000_000, 128  # of the shipped weights and their encoder, see shipped_weights.sh


@dataclass(frozen=True)
class TrainSettings:
    """Settings that determine the result of a training run.

    passes: sample passes in total, the paper's 16 M x 8 epochs being 128 M. batch: samples (views) per step. schedule:
    "paper" (drops to a tenth after 4/8 and 7/8 of the run, methods 7.21) or "cosine". warm_up: steps of rising learning
    rate. average: decay of the moving mean of weights that is saved, 0 for none. clip: largest norm of a gradient, 0
    for no limit. augment: methods 7.20. luminance_weight: factor of |dL| in the loss. precision: "fp32"; "bf16" for the
    encoder's products; "tf32" for all products on a GPU, fp32 on a CPU; or "auto": fp32 on a GPU, on a CPU bf16 if the
    processor has it natively, and fp32 for the last fiftieth. network: its kind (`network/kinds.py`). loss: "absolute"
    errors, minimized by medians, or "squared" ones, minimized by means, which pictures and mean squared errors need.
    encoder: its architecture (`encoders.py`). fresh: each step draws new voxels and views from the octrees instead of
    reading sample files. decoder_width: values between the layers of a mixture's decoder, a multiple of 6; 0
    for the default of the kind. encoder_width: values between the layers of the encoder `mlp`, a multiple of 64; 0 for
    the paper's, and for convolutional encoders.
    """

    passes: int = 8 * SAMPLES
    batch: int = 8192
    learning_rate: float = 1e-3
    final_rate: float = 1e-5
    schedule: str = "paper"
    warm_up: int = 0
    average: float = 0.0
    clip: float = 0.0
    augment: bool = False
    luminance_weight: float = 1.0
    precision: str = AUTO
    seed: int = 0
    network: str = PAPER_KIND.name
    loss: str = ABSOLUTE
    encoder: str = MLP.name
    fresh: bool = False
    decoder_width: int = 0
    encoder_width: int = 0

    def __post_init__(self) -> None:
        own = KINDS[self.network]
        if not self.decoder_width:
            object.__setattr__(self, "decoder_width", own.width)  # as in checkpoints
        bounds.DECODER_WIDTH.check(self.decoder_width)
        if self.decoder_width % WIDTH_STEP:
            raise SettingError(f"Decoder width {self.decoder_width} is not a multiple of {WIDTH_STEP}: choose one")
        if self.decoder_width != own.width and not own.mixes:
            raise SettingError(f"The decoder of the network '{own.name}' is {own.width} wide: omit --decoder-width")
        if not self.encoder_width:
            object.__setattr__(self, "encoder_width", ENCODERS[self.encoder].width)
        if not isinstance(ENCODERS[self.encoder], ConvolvingKind):
            bounds.ENCODER_WIDTH.check(self.encoder_width)
        elif self.encoder_width:
            raise SettingError(f"The look-ahead determines the width of '{self.encoder}': omit --encoder-width")
        if self.encoder_width % MLP_WIDTH_STEP:
            step = MLP_WIDTH_STEP
            raise SettingError(f"Encoder width {self.encoder_width} is not a multiple of {step}: choose a multiple")

    @property
    def kind(self) -> NetworkKind:
        """Kind of network, with this width of the decoder."""
        return KINDS[self.network].of_width(self.decoder_width)

    @property
    def encoder_kind(self) -> EncoderKind:
        """Architecture of the encoder, with this width."""
        own = ENCODERS[self.encoder]
        return own.of_width(self.encoder_width) if own.width else own


PAPER = TrainSettings()
IMPROVED = TrainSettings(
    batch=2048,
    learning_rate=2e-3,
    schedule="cosine",
    warm_up=500,
    average=0.999,
    clip=1.0,
    augment=True,
    luminance_weight=10.0,
    network=MIXTURE.name,
    loss=SQUARED,
)
_FULL_RUN = IMPROVED.passes // IMPROVED.batch  # steps of the preset's learning rate


def of_length(settings: TrainSettings) -> TrainSettings:
    """Settings with a learning rate and warm-up for a run of so many steps with a cosine schedule.

    The best rate is inversely proportional to the root of the number of steps (docs/lab/training.md, "Length of a
    run").
    """
    steps = max(1, settings.passes // settings.batch)
    rate = min(IMPROVED.learning_rate * max(1.0, _FULL_RUN / steps) ** 0.5, _HIGHEST_RATE)
    return replace(settings, learning_rate=rate, warm_up=min(IMPROVED.warm_up, int(_WARM_UP_SHARE * steps)))


PRESETS = {"quick": of_length(replace(IMPROVED, passes=8 * QUICK_SAMPLES)), "paper": PAPER, "improved": IMPROVED}


def preset_with(preset: str, changes: Mapping[str, Any]) -> TrainSettings:
    """Preset with the values of `changes` that are not None; another network or encoder has its own width.

    If neither preset nor schedule is the paper's, default warm-up and learning rate depend on the run's length
    (`of_length`).
    """
    given = {name: value for name, value in changes.items() if value is not None}
    own = {width: 0 for what, width in (("network", "decoder_width"), ("encoder", "encoder_width")) if what in given}
    settings = replace(PRESETS[preset], **(own | given))
    if "paper" in (PRESETS[preset].schedule, settings.schedule):
        return settings
    fitted = of_length(settings)
    return replace(fitted, learning_rate=settings.learning_rate) if "learning_rate" in given else fitted
