"""A training of seconds, for the tests."""

from etd_ros.recovery.training.config import TrainingConfig

SHORT = TrainingConfig(
    steps=60,
    batch=4,
    sequences=4,
    first_sequences=2,
    steps_per_sequence=5,
    warm_up_steps=5,
    validation_sequences=1,
    validation_batches=4,
    interval=30,
)
