"""Object proposals near a target's last box (paper Sec. 3.3, detection stage)."""

from etd_ros.detection.admissibility import admissibility
from etd_ros.detection.edge_boxes import EdgeBoxes, EdgeBoxesConfig, Proposals
from etd_ros.detection.edges import edge_orientation, edges_of, thin_edges
from etd_ros.detection.errors import DetectionError

__all__ = [
    "DetectionError",
    "EdgeBoxes",
    "EdgeBoxesConfig",
    "Proposals",
    "admissibility",
    "edge_orientation",
    "edges_of",
    "thin_edges",
]
