"""Labelled sequences, as their publishers give them or in folders of a user's own."""

from etd_ros.datasets.interface import DatasetError, LabelledSequence
from etd_ros.datasets.opening import DATASETS, open_dataset
from etd_ros.datasets.sequences import find_sequences

__all__ = ["DATASETS", "DatasetError", "LabelledSequence", "find_sequences", "open_dataset"]
