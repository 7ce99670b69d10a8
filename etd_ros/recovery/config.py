"""Parameters of the recovery of lost targets."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from etd_ros.parameters import Parameters, parameter

AUTO, COMPACT, SIAMRPN = "auto", "compact", "siamrpn"
NETWORKS = (COMPACT, SIAMRPN)
OPENCV_TRACKERS = ("csrt", "kcf", "nano", "vit", "dasiamrpn")


@dataclass(frozen=True)
class RecoveryConfig(Parameters):
    """Parameters of the recovery of lost targets."""

    tracker: str = parameter(
        AUTO,
        "what finds a lost target: a Siamese network (compact, or siamrpn with a DaSiamRPN file), or correlation put "
        "right by an OpenCV tracker (nano, vit and dasiamrpn need model files); auto is compact where torch and "
        "safetensors are installed, else csrt",
        choices=(AUTO, *NETWORKS, *OPENCV_TRACKERS),
    )
    network_score_min: float = parameter(
        0.65,
        "compact, siamrpn: smallest score, distractors taken off, that counts as found: lower finds sooner, and wrong "
        "ones",
        low=0.0,
        high=1.0,
    )
    network_margin_min: float = parameter(
        0.4, "compact, siamrpn: smallest distance of the best score to the second best place's", low=0.0, high=1.0
    )
    network_agreeing: int = parameter(
        5, "compact, siamrpn: successive searches that must find the target at the same place", low=1, high=100
    )
    watch_score_min: float = parameter(
        0.8,
        "compact: smallest score that counts while a target is followed: one that is seen elsewhere so surely has "
        "drifted, and is followed there; 1: nobody looks",
        low=0.0,
        high=1.0,
    )
    distractor_weight: float = parameter(
        0.5,
        "compact, siamrpn: share of a place's likeness to distractors that is taken off its score",
        low=0.0,
        high=1.0,
    )
    compact_model: str = parameter("", "file of the compact tracker's weights (safetensors); empty: those shipped")
    siamrpn_model: str = parameter(
        "",
        "file of the weights of siamrpn, and of the compared system dasiamrpn, which is compact where it is empty: "
        "SiamRPNVOT.model, OTB or BIG",
    )
    siamfc_model: str = parameter(
        "",
        "of the compared system siamfc, which recovery does not use: file of its weights, siamfc_alexnet_e50.pth or a "
        "siamfc.safetensors made by `train`; empty: those shipped",
    )
    score_min: float = parameter(
        0.75,
        "OpenCV trackers: smallest correlation with the remembered target that counts as found: lower finds sooner, "
        "and wrong ones",
        low=0.0,
        high=1.0,
    )
    texture_min: float = parameter(
        5.0, "smallest standard deviation of a target's pixels (grey levels): less is not compared", low=0.1, high=127.0
    )
    size_ratio_max: float = parameter(
        1.6, "largest ratio, either way, of the found width or height to the remembered one", low=1.0, high=10.0
    )
    search_scale: float = parameter(
        3.0, "width and height of the first search region, in those of the remembered target", low=1.0, high=100.0
    )
    search_growth: float = parameter(
        0.1,
        "what a search without success adds to the scale of the search region; of a lost target of etd-plus ten times "
        "as much",
        low=0.0,
        high=100.0,
    )
    search_scale_max: float = parameter(
        8.0,
        "OpenCV trackers: largest scale of the search region, larger reaches farther and costs time; networks search "
        "up to the whole image, in parts",
        low=1.0,
        high=100.0,
    )
    exemplar_interval: int = parameter(
        20,
        "tracked images from one remembered appearance to the next; one is used once the next has come, "
        "because what a failing tracker saw last is often not the target",
        low=1,
        high=100_000,
    )
    nano_backbone: str = parameter("", "file of the nano tracker's backbone (ONNX)")
    nano_head: str = parameter("", "file of the nano tracker's neck and head (ONNX)")
    vit_model: str = parameter("", "file of the vit tracker's network (ONNX)")
    dasiamrpn_model: str = parameter("", "file of the dasiamrpn tracker's network (ONNX)")
    dasiamrpn_kernel_cls1: str = parameter("", "file of the dasiamrpn tracker's classification kernel (ONNX)")
    dasiamrpn_kernel_r1: str = parameter("", "file of the dasiamrpn tracker's regression kernel (ONNX)")

    @property
    def names_model(self) -> bool:
        """Whether any model file is named."""
        return any(value for name, value in asdict(self).items() if isinstance(value, str) and name != "tracker")
