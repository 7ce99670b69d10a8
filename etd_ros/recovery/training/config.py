"""What is trained on, for how long, and how pairs are made harder."""

from __future__ import annotations

from dataclasses import dataclass

from etd_ros.parameters import Parameters, parameter

SEQUENCES_MAX = 1_000_000
VALIDATION_SEEDS = SEQUENCES_MAX
"""Training draws sequences from seeds below, validation from here on."""


@dataclass(frozen=True)
class TrainingConfig(Parameters):
    """Schedule, batches and data of a training."""

    steps: int = parameter(20_000, "steps, each on one batch", low=1, high=100_000_000)
    batch: int = parameter(16, "pairs in a batch", low=2, high=4096)
    learning_rate: float = parameter(0.002, "largest step size of AdamW", low=1e-7, high=1.0)
    weight_decay: float = parameter(0.02, "weight decay of AdamW", low=0.0, high=1.0)
    warm_up_steps: int = parameter(300, "steps over which the step size rises", low=0, high=1_000_000)
    settled: float = parameter(
        0.3,
        "share of the training at its end in which batch normalisations keep their statistics, so that what is trained "
        "is what runs; 1 is for weights that are trained further, which have some",
        low=0.0,
        high=1.0,
    )
    sequences: int = parameter(2000, "simulated sequences in the cache, 4 MB each", low=1, high=SEQUENCES_MAX)
    first_sequences: int = parameter(60, "sequences that are made before the first step", low=1, high=SEQUENCES_MAX)
    steps_per_sequence: int = parameter(
        10, "steps after which one more sequence is drawn from, as long as there are more", low=1, high=1_000_000
    )
    validation_sequences: int = parameter(40, "sequences for validation", low=1, high=100_000)
    validation_batches: int = parameter(30, "batches for validation", low=1, high=100_000)
    interval: int = parameter(1000, "steps between validations and checkpoints", low=1, high=1_000_000)
    seed: int = parameter(0, "of the first weights and of all choices", low=0, high=2**31)

    def pool(self, step: int) -> int:
        """How many sequences are drawn from at a step."""
        return min(self.sequences, self.first_sequences + step // self.steps_per_sequence)


@dataclass(frozen=True)
class AugmentationConfig(Parameters):
    """How pairs are made harder than what was simulated."""

    shift_px: float = parameter(
        44.0, "largest shift of the target from the window's middle (pixels)", low=0.0, high=64.0
    )
    scale: float = parameter(0.25, "largest change of the window's scale (natural logarithm)", low=0.0, high=1.0)
    box_noise: float = parameter(
        0.08, "standard deviation of the remembered box's sides and centre, as a share of it", low=0.0, high=0.5
    )
    elsewhere: float = parameter(
        0.35, "share of windows that are not centred at the target but anywhere, mostly on something else",
        low=0.0, high=1.0,
    )  # fmt: skip
    gain: float = parameter(0.3, "standard deviation of a crop's contrast (natural logarithm)", low=0.0, high=1.0)
    noise_levels: float = parameter(6.0, "largest standard deviation of noise (grey levels)", low=0.0, high=60.0)
