"""Parameters of following contours."""

from __future__ import annotations

from dataclasses import dataclass, replace

from etd_ros.parameters import Parameters, parameter


@dataclass(frozen=True)
class ContourConfig(Parameters):
    """Parameters of `etd-plus`: fitting a target's contours."""

    search_radius: int = parameter(
        4, "how far from the predicted place a target is looked for (pixels)", low=1, high=64
    )
    window_px: float = parameter(
        2.0,
        "the events of so much motion are looked at together (pixels), of a fast target with few those of more",
        low=0.2,
        high=20.0,
    )
    window_max_s: float = parameter(0.1, "longest time of events that are looked at together (s)", low=0.001, high=10.0)
    learning_rate: float = parameter(
        0.02, "share of the model that a look renews: higher follows changes, and drifts", low=0.0, high=1.0
    )
    scale_gain: float = parameter(
        0.4, "share of a measured change of scale that is taken on; 0 keeps the size", low=0.0, high=1.0
    )
    angle_gain: float = parameter(
        0.3,
        "share of a measured turn that is taken on; 0 keeps the model upright",
        low=0.0,
        high=1.0,
    )
    refine_gain: float = parameter(
        0.25,
        "share of what the box network sees a box off by that is put right at once; 0: it is not asked",
        low=0.0,
        high=1.0,
    )
    refine_sizes_per_s: float = parameter(
        8.0,
        "of boxes that move by fewer of their sizes a second, only what exceeds the network's error is put right",
        low=0.0,
        high=1e6,
    )
    frame_motion: float = parameter(
        0.02,
        "frames last until a target has moved by this share of its size, 5 ms if it is slow, or as atsltd says",
        low=0.001,
        high=100.0,
    )
    person_classes: tuple[str, ...] = parameter(
        ("person", "pedestrian"),
        "targets of these classes, in capitals or not, stay upright: a stride is not taken for turning",
    )
    ridge_weight: float = parameter(
        0.5, "weight of where events are, beside which polarity they have", low=0.0, high=10.0
    )

    def for_class(self, class_id: str) -> ContourConfig:
        """The parameters by which a target of a class is followed, "" where that is not known: people stay upright."""
        people = {name.strip().casefold() for name in self.person_classes}
        named = class_id.strip().casefold()
        return replace(self, angle_gain=0.0) if named and named in people else self
