"""What the paper printed: AP and AR of ten methods on eight sequences.

H. Chen, Q. Wu, Y. Liang, X. Gao, H. Wang: Asynchronous Tracking-by-Detection on Adaptive Time Surfaces for Event-based
Object Tracking (ACM Multimedia 2019), Tables 2 (ECD) and 3 (EED). Its labels of the ECD sequences were not published:
figures on other labels can be held beside these, not against them.
"""

from __future__ import annotations

METHODS = {
    "kcf": "KCF",
    "tld": "TLD",
    "siamfc": "SiamFC",
    "eco": "ECO",
    "dasiamrpn": "DaSiamRPN",
    "dasiamrpn-e": "DaSiamRPN-E",
    "e-ms": "E-MS",
    "etd-ftw": "ETD-FTW",
    "etd-nr": "ETD-NR",
    "etd": "ETD",
}
"""The names in this project, and the paper's."""

_SYSTEMS = tuple(METHODS)
_PRINTED: dict[str, tuple[tuple[float, float], ...]] = {
    "shapes_translation": (
        (0.306, 0.468), (0.468, 0.425), (0.685, 0.872), (0.746, 0.931), (0.668, 0.878),
        (0.728, 0.913), (0.675, 0.768), (0.734, 0.922), (0.793, 0.982), (0.817, 0.998),
    ),
    "shapes_6dof": (
        (0.307, 0.430), (0.430, 0.424), (0.668, 0.842), (0.717, 0.877), (0.642, 0.831),
        (0.749, 0.878), (0.612, 0.668), (0.727, 0.924), (0.783, 0.972), (0.809, 0.998),
    ),
    "poster_6dof": (
        (0.345, 0.472), (0.472, 0.554), (0.585, 0.726), (0.614, 0.719), (0.517, 0.651),
        (0.692, 0.814), (0.417, 0.373), (0.707, 0.918), (0.775, 0.992), (0.788, 0.995),
    ),
    "slider_depth": (
        (0.674, 0.780), (0.504, 0.643), (0.806, 0.910), (0.915, 0.667), (0.713, 0.890),
        (0.803, 0.974), (0.447, 0.350), (0.636, 0.766), (0.803, 0.983), (0.816, 0.997),
    ),
    "fast_drone": (
        (0.169, 0.176), (0.315, 0.118), (0.559, 0.667), (0.637, 0.833), (0.673, 0.853),
        (0.646, 0.847), (0.313, 0.307), (0.576, 0.673), (0.722, 0.883), (0.738, 0.897),
    ),
    "light_variations": (
        (0.107, 0.066), (0.045, 0.066), (0.599, 0.675), (0.586, 0.688), (0.654, 0.894),
        (0.705, 0.902), (0.325, 0.321), (0.722, 0.874), (0.833, 0.925), (0.842, 0.933),
    ),
    "what_is_background": (
        (0.028, 0.000), (0.269, 0.333), (0.307, 0.308), (0.616, 0.692), (0.678, 0.833),
        (0.573, 0.742), (0.362, 0.360), (0.562, 0.733), (0.638, 0.781), (0.653, 0.807),
    ),
    "occlusions": (
        (0.004, 0.000), (0.092, 0.167), (0.148, 0.000), (0.108, 0.143), (0.189, 0.333),
        (0.373, 0.605), (0.356, 0.353), (0.263, 0.533), (0.414, 0.622), (0.431, 0.647),
    ),
}  # fmt: skip
"""(AP, AR) of each method, in the order of `METHODS`."""


def printed(sequence: str) -> dict[str, tuple[float, float]]:
    """The paper's (AP, AR) of each of its methods, by this project's names; empty for a sequence that is none of its
    eight."""
    return dict(zip(_SYSTEMS, _PRINTED.get(sequence, ()), strict=False))
