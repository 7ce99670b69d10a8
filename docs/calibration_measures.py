"""The figures of calibration.md: which measure of contour clarity finds the same contours at every speed.

    python docs/calibration_measures.py [RECORDING ...] [--plot docs/calibration_measures.png]

Needs scikit-image and Matplotlib beside the package.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path as FilePath

import cv2
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from skimage.morphology import skeletonize

from etd_ros.conversion import PAPER_INTERVAL, nzge
from etd_ros.conversion.calibration import CalibrationConfig, clarity, frame_data
from etd_ros.events import Events, concatenate
from etd_ros.recordings import open_recording
from etd_ros.simulation import TEXTURES, Path, Scene, SensorConfig, Sprite, Waypoint, simulate

Data = npt.NDArray[np.uint8]

WIDTH, HEIGHT = 240, 180
TRAVEL_PX = 30
SPEEDS_PX_S = (50, 200, 1000)
STARTS_PX = (2, 6, 10)
RECORDED_INSTANTS = 25
PIECE_MIN_PX = 10
SEED = 3


def discs(rng: np.random.Generator, height: int, width: int) -> npt.NDArray[np.float64]:
    """A few dark discs on a bright wall: sparse contours of high contrast."""
    wall = np.full((height, width), 0.8)
    for _ in range(height * width // 7000):
        centre = int(rng.uniform(0, width)), int(rng.uniform(0, height))
        cv2.circle(wall, centre, int(rng.uniform(8, 26)), float(rng.uniform(0.2, 0.5)), cv2.FILLED)
    return cv2.GaussianBlur(wall, (0, 0), 0.7)


def faint(rng: np.random.Generator, height: int, width: int) -> npt.NDArray[np.float64]:
    """Cloudy patches of half the contrast."""
    return 0.4 + 0.35 * TEXTURES["smooth_noise"](rng, height, width)


SCENES: dict[str, Callable[..., npt.NDArray[np.float64]]] = {
    "discs": discs,
    "checks": lambda rng, height, width: TEXTURES["checks"](rng, height, width, cell=12),
    "stripes": TEXTURES["stripes"],
    "smooth_noise": TEXTURES["smooth_noise"],
    "faint noise": faint,
}


def sharpness(data: Data) -> float:
    """Gradient energy over energy."""
    return clarity(data).sharpness


def connectedness(data: Data) -> float:
    """Share of event pixels with two neighbours, above chance."""
    return clarity(data).connectedness


def ridge_length(data: Data) -> float:
    """Length of the contours' middle lines, short pieces left out, per event pixel."""
    length = 0
    for channel in range(2):
        middle = skeletonize(data[:, :, channel] > 0).astype(np.uint8)
        areas = cv2.connectedComponentsWithStats(middle, connectivity=8)[2][1:, cv2.CC_STAT_AREA]
        length += int(areas[areas >= PIECE_MIN_PX].sum())
    return length / max(1, np.count_nonzero(data))


def coherence(data: Data) -> float:
    """Mean over event pixels of the structure tensor's ((l1 - l2) / (l1 + l2))^2, within about 2 px."""
    total = 0.0
    for channel in range(2):
        has_event = (data[:, :, channel] > 0).astype(np.float32)
        smooth = cv2.GaussianBlur(has_event, (0, 0), 0.7)
        gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, dx, dy) for dx, dy in ((1, 0), (0, 1)))
        xx, xy, yy = (cv2.GaussianBlur(product, (0, 0), 2.0) for product in (gx * gx, gx * gy, gy * gy))
        total += float(((((xx - yy) ** 2 + 4 * xy**2) / (xx + yy + 1e-9) ** 2) * has_event).sum())
    return total / max(1, np.count_nonzero(data))


def product(data: Data) -> float:
    """Sharpness times connectedness: what `calibrate` takes."""
    return clarity(data).value


MEASURES: tuple[Callable[[Data], float], ...] = (sharpness, connectedness, ridge_length, coherence, product)


@dataclass(frozen=True)
class Ladder:
    """Frames of growing length from one instant.

    Attributes:
        durations_s: their lengths, shape (n,).
        nzge: their NZGE, shape (n,).
        values: each measure's values, shape (measures, n).
    """

    durations_s: npt.NDArray[np.float64]
    nzge: npt.NDArray[np.float64]
    values: npt.NDArray[np.float64]


def moving(surface_of: Callable[..., npt.NDArray[np.float64]], speed_px_s: float) -> Events:
    """Events of a texture that fills the sensor and moves by TRAVEL_PX."""
    surface = surface_of(np.random.default_rng(SEED), HEIGHT + 2 * TRAVEL_PX, WIDTH + 2 * TRAVEL_PX)
    duration_s = TRAVEL_PX / speed_px_s
    half_x, half_y = 0.4 * TRAVEL_PX, 0.3 * TRAVEL_PX
    ends = ((0.0, -1), (duration_s, 1))
    path = Path([Waypoint(time_s, WIDTH / 2 + side * half_x, HEIGHT / 2 + side * half_y) for time_s, side in ends])
    sprite = Sprite("wall", surface, np.ones_like(surface), path)
    scene = Scene(WIDTH, HEIGHT, duration_s, np.full((HEIGHT, WIDTH), 0.5), (sprite,))
    return concatenate(list(simulate(scene, seed=SEED, config=SensorConfig(step_s=0.2 / speed_px_s))))


def climb(events: Events, config: CalibrationConfig) -> Ladder:
    """All frames that begin with the first of these events."""
    durations_s, entropies, values = [], [], []
    count = float(config.events_min)
    while count <= min(len(events), events.width * events.height):
        part = events[: round(count)]
        duration_s = (int(part.t[-1]) - int(part.t[0])) / 1e9
        if duration_s > config.duration_max_s:
            break
        data = frame_data(part)
        durations_s.append(duration_s)
        entropies.append(nzge(data))
        values.append([measure(data) for measure in MEASURES])
        count *= config.growth
    return Ladder(np.array(durations_s), np.array(entropies), np.array(values).T)


def simulated_ladders(name: str, speed_px_s: float) -> Iterator[Ladder]:
    """Ladders of a scene at STARTS_PX."""
    events = moving(SCENES[name], speed_px_s)
    for start_px in STARTS_PX:
        first = int(np.searchsorted(events.t, start_px / speed_px_s * 1e9))
        yield climb(events[first:], CalibrationConfig())


def recorded_ladders(path: FilePath) -> Iterator[Ladder]:
    """Ladders of a recording at instants equally many events apart."""
    with open_recording(path) as recording:
        events = concatenate(list(recording.events()))
    for first in range(0, len(events), -(-len(events) // RECORDED_INSTANTS)):
        yield climb(events[first:], CalibrationConfig())


def best(ladders: list[Ladder], measure: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], int]:
    """(durations, NZGE) of the frames that a measure chooses, and how many ladders have no maximum inside."""
    chosen = [int(np.argmax(ladder.values[measure])) for ladder in ladders]
    inside = [0 < index < len(ladder.nzge) - 1 for index, ladder in zip(chosen, ladders, strict=True)]
    durations_s = np.array([ladder.durations_s[index] for index, ladder in zip(chosen, ladders, strict=True)])
    entropies = np.array([ladder.nzge[index] for index, ladder in zip(chosen, ladders, strict=True)])
    return durations_s, entropies, len(inside) - sum(inside)


def simulated_table(found: dict[tuple[str, int], list[Ladder]]) -> str:
    """Displacement at each measure's maximum, at each speed, and NZGE there."""
    speeds = "/".join(map(str, SPEEDS_PX_S))
    lines = [f"| scene | {' | '.join(measure.__name__ for measure in MEASURES)} | NZGE = alpha |", "|-" * 7 + "|"]
    for name in SCENES:
        cells = []
        for measure in range(len(MEASURES)):
            chosen = [best(found[name, speed], measure) for speed in SPEEDS_PX_S]
            px = [
                float(np.median(durations)) * speed
                for (durations, _, _), speed in zip(chosen, SPEEDS_PX_S, strict=True)
            ]
            entropy = float(np.mean([entropies.mean() for _, entropies, _ in chosen]))
            outside = " (end)" if sum(count for _, _, count in chosen) > len(STARTS_PX) else ""
            cells.append(f"{'/'.join(f'{value:.1f}' for value in px)} px, {entropy:.3f}{outside}")
        at_alpha = [alpha_displacement_px(found[name, speed], speed) for speed in SPEEDS_PX_S]
        lines.append(f"| {name} | {' | '.join(cells)} | {'/'.join(at_alpha)} px |")
    return f"Displacement at {speeds} px/s and mean NZGE at each measure's maximum\n\n" + "\n".join(lines) + "\n"


def alpha_displacement_px(ladders: list[Ladder], speed_px_s: float) -> str:
    """How far contours have moved when NZGE reaches the paper's alpha."""
    reached = [ladder.durations_s[ladder.nzge >= PAPER_INTERVAL[0]] for ladder in ladders]
    first_s = [float(durations_s[0]) for durations_s in reached if len(durations_s)]
    return f"{np.median(first_s) * speed_px_s:.1f}" if len(first_s) == len(ladders) else "-"


def recorded_table(name: str, ladders: list[Ladder]) -> str:
    """Length and NZGE of the frames that each measure chooses."""
    lines = [
        f"\n{name}, {len(ladders)} instants\n",
        "| measure | median length | NZGE | no maximum inside |",
        "|-|-|-|-|",
    ]
    for index, measure in enumerate(MEASURES):
        durations_s, entropies, outside = best(ladders, index)
        spread = f"{entropies.mean():.4f} +- {entropies.std(ddof=1):.4f}"
        lines.append(f"| {measure.__name__} | {np.median(durations_s) * 1e3:.1f} ms | {spread} | {outside} |")
    return "\n".join(lines) + "\n"


def plot(found: dict[tuple[str, int], list[Ladder]], path: FilePath) -> None:
    """Each measure over displacement, as a share of its largest value, at the middle speed."""
    speed = SPEEDS_PX_S[1]
    figure = Figure(figsize=(13.0, 3.4), layout="constrained")
    for index, (axes, measure) in enumerate(zip(figure.subplots(1, len(MEASURES), sharey=True), MEASURES, strict=True)):
        for name in SCENES:
            ladder = found[name, speed][1]
            axes.semilogx(ladder.durations_s * speed, ladder.values[index] / ladder.values[index].max(), label=name)
        axes.set(title=measure.__name__.replace("_", " "), xlabel="displacement (px)", xlim=(0.1, 25))
    figure.axes[0].set_ylabel("share of the largest value")
    figure.axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=90)


def main() -> int:
    """Print the tables, draw the plot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", type=FilePath, nargs="*", metavar="RECORDING")
    parser.add_argument("--plot", type=FilePath, metavar="FILE.png")
    options = parser.parse_args()
    found = {(name, speed): list(simulated_ladders(name, speed)) for name in SCENES for speed in SPEEDS_PX_S}
    sys.stdout.write(simulated_table(found))
    for path in options.recordings:
        sys.stdout.write(
            recorded_table(path.name, [ladder for ladder in recorded_ladders(path) if len(ladder.nzge) > 2])
        )
    if options.plot:
        plot(found, options.plot)
    return 0


if __name__ == "__main__":
    sys.exit(main())
