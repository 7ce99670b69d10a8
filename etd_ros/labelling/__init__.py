"""Box labels made by hand: pictures of a recording, key frames, and the browser page in which they are drawn."""

from etd_ros.labelling.key_frames import KeyFrame, LabellingError
from etd_ros.labelling.pictures import Pictures, make_pictures
from etd_ros.labelling.server import LabelServer
from etd_ros.labelling.session import LabelSession

__all__ = ["KeyFrame", "LabelServer", "LabelSession", "LabellingError", "Pictures", "make_pictures"]
