"""Recordings of every known container as events and images in time order, read lazily and in bounded memory."""

from etd_ros.recordings.files import recording_files
from etd_ros.recordings.interface import RecordedImage, RecordedMessage, Recording, RecordingError, TopicInfo
from etd_ros.recordings.opening import open_recording

__all__ = [
    "RecordedImage",
    "RecordedMessage",
    "Recording",
    "RecordingError",
    "TopicInfo",
    "open_recording",
    "recording_files",
]
