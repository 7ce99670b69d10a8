"""Labelled sequences, as their publishers give them or in folders of a user's own."""

from etd_ros.datasets.interface import DatasetError, LabelledSequence
from etd_ros.datasets.opening import DATASETS, open_dataset

__all__ = ["DATASETS", "DatasetError", "LabelledSequence", "open_dataset"]
