"""How speed depends on the rate of events, the sensor's size, the share of pixels that is active, and the messages."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from etd_ros.benchmarking import subjects
from etd_ros.benchmarking.decoding import PACKET_TYPE
from etd_ros.benchmarking.encoders import FRAME_ID
from etd_ros.benchmarking.measure import Subject, compare
from etd_ros.benchmarking.references import BARE_MAP, bare_map
from etd_ros.benchmarking.streams import MESSAGE_EVENTS_MAX, Stream, texture
from etd_ros.events import Events
from etd_ros.plots import check_matplotlib
from msg_adapters import Layout, encode_event_packet

MEV = 1_000_000
SEED = 1
FIGURE_INCHES = (10.0, 7.0)
DPI = 110
SPEED_TICKS = (2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)


@dataclass(frozen=True)
class Setting:
    """A texture to measure on; what is not varied stays as here."""

    rate: float = 10 * MEV
    size: tuple[int, int] = (640, 480)
    active_share: float = 0.1
    message_events: int = MESSAGE_EVENTS_MAX

    def messages(self, count: int) -> list[Events]:
        """`count` events in messages of at most 10 ms."""
        events = texture(*self.size, count, self.rate, SEED, self.active_share)
        return Stream("texture", events).messages(self.message_events)


@dataclass(frozen=True)
class Panel:
    """What is varied: an axis and a setting for each place on it."""

    axis: str
    settings: dict[float, Setting]

    def label(self, place: float) -> str:
        """What stands at a place on the axis."""
        width, height = self.settings[place].size
        return f"{width}x{height}" if place == width * height else f"{place:g}"


PANELS = (
    Panel("event rate (Mev/s)", {rate: Setting(rate=rate * MEV) for rate in (1, 3, 10, 30, 100)}),
    Panel(
        "sensor size (pixels)",
        {
            width * height: Setting(size=(width, height))
            for width, height in ((160, 120), (320, 240), (640, 480), (1280, 720), (2560, 1440))
        },
    ),
    Panel(
        "active share of the pixels (%)", {100 * share: Setting(active_share=share) for share in (0.01, 0.1, 0.5, 1.0)}
    ),
    Panel("message size (events)", {count: Setting(message_events=count) for count in (100, 1000, 10_000, 100_000)}),
)


@dataclass(frozen=True)
class Point:
    """A measured speed: which panel and part of the event path it belongs to, where on the axis, and Mev/s."""

    axis: str
    part: str
    place: float
    mev_per_s: float


def scaling(events: int, rounds: int) -> Iterator[Point]:
    """All points, one by one as they are measured.

    Args:
        events: events in a stream.
        rounds: runs for each point; their median counts.
    """
    for panel in PANELS:
        for place, setting in panel.settings.items():
            messages = setting.messages(events)
            for part, subject_of in PARTS.items():
                seconds = compare(subject_of(messages), None, rounds).ours_s
                yield Point(panel.axis, part, place, 1e-6 / float(np.median(seconds)))


def scaling_png(points: Sequence[Point]) -> bytes:
    """A PNG with a panel for each thing that is varied, and a curve in it for each part of the event path.

    Raises:
        PlotError: Matplotlib is missing.
    """
    check_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=FIGURE_INCHES, layout="constrained")
    grid = figure.subplots(2, 2, sharey=True)
    for axes, panel in zip(grid.flat, PANELS, strict=True):
        for part in PARTS:
            curve = [point for point in points if (point.axis, point.part) == (panel.axis, part)]
            style = "k--" if part == BARE_MAP else "o-"
            axes.plot([point.place for point in curve], [point.mev_per_s for point in curve], style, label=part)
        axes.set(xscale="log", yscale="log", xlabel=panel.axis)
        axes.set_xticks(list(panel.settings), [panel.label(place) for place in panel.settings])
        axes.set_yticks(SPEED_TICKS, [str(speed) for speed in SPEED_TICKS])
        axes.minorticks_off()
        axes.set_ylim(1, 2 * SPEED_TICKS[-1])
        axes.grid(visible=True, alpha=0.3)
    for axes in grid[:, 0]:
        axes.set_ylabel("speed, one thread (Mev/s)")
    grid[0, 0].legend(fontsize="small", loc="lower left")
    default = Setting()
    figure.suptitle(
        f"A moving texture; where not varied {default.rate / MEV:g} Mev/s, {default.size[0]}x{default.size[1]} pixels, "
        f"{default.active_share:.0%} of them active, messages of 10 ms",
        fontsize="medium",
    )
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def _mono_decoding(messages: Sequence[Events]) -> Subject:
    encoded = [
        encode_event_packet(events, stamp_ns=int(events.t[-1]), frame_id=FRAME_ID, seq=seq)
        for seq, events in enumerate(messages)
    ]
    return subjects.decoding(encoded, PACKET_TYPE, Layout.ROS2, sum(map(len, messages)))


PARTS: dict[str, Callable[[Sequence[Events]], Subject]] = {
    "ATSLTD conversion": subjects.conversion,
    "high-pass reconstruction": subjects.high_pass,
    "noise filter": subjects.noise_filter,
    "decoding of mono": _mono_decoding,
    BARE_MAP: bare_map,
}
