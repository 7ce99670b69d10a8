"""Truth and track files, and how well tracks agree with the truth."""

from etd_ros.evaluation.scoring import Score, mean_score, score
from etd_ros.evaluation.table import EvaluationError
from etd_ros.evaluation.tracks import TRACKS_COLUMNS, TrackRow, TracksWriter, read_tracks
from etd_ros.evaluation.truth import CLASS_COLUMN, TimedBox, read_boxes, write_boxes

__all__ = [
    "CLASS_COLUMN",
    "TRACKS_COLUMNS",
    "EvaluationError",
    "Score",
    "TimedBox",
    "TrackRow",
    "TracksWriter",
    "mean_score",
    "read_boxes",
    "read_tracks",
    "score",
    "write_boxes",
]
