"""ECO with hand-crafted features: follows one target from picture to picture."""

from __future__ import annotations

import math

import numpy as np

from etd_ros.boxes import Box
from etd_ros.systems.eco.config import EcoConfig
from etd_ros.systems.eco.features import Features, project, project_all
from etd_ros.systems.eco.fourier import Spectra, label_spectrum, shifted
from etd_ros.systems.eco.learning import FilterLearner, learn_first, sample_energy
from etd_ros.systems.eco.localisation import find_peak
from etd_ros.systems.eco.pictures import Pyramid, grey
from etd_ros.systems.eco.samples import SampleSpace, filter_samples
from etd_ros.systems.eco.scale import ScaleFilter
from etd_ros.systems.eco.window import PenaltyWindow
from etd_ros.systems.interface import Answer, CompareError, Picture

SEARCH_SIDE_MIN_PX = 5.0
"""The search area does not become smaller than this."""
OVERLAP_MIN_PX = 1.0
"""So much of a target that leaves the picture stays in it, so that it is still looked for at the border."""


class EcoTracker:
    """A `PictureTracker`: Efficient Convolution Operators (Danelljan et al., CVPR 2017), the variant ECO-HC.

    A filter on oriented gradients and intensity channels of the target's surroundings finds its place, a second one
    its size. It always gives a box. The score is the filter's answer there, clipped to 0..1: it was taught to answer 1,
    and answers about 0.5 as long as the target looks as it did.
    """

    def __init__(self, config: EcoConfig | None = None) -> None:
        self._config = config or EcoConfig()
        self._follower: _Follower | None = None

    def start(self, picture: Picture, box: Box) -> None:
        """The target is at `box` (pixels) in this picture.

        Raises:
            CompareError: `picture` is not uint8, grey or BGR.
            BoxError: the box has no area, or lies off the picture.
        """
        pyramid = Pyramid(grey(picture))
        box.check(*pyramid.size)
        self._follower = _Follower(pyramid, box, self._config)

    def update(self, picture: Picture) -> Answer:
        """Where it is in the next picture.

        Raises:
            CompareError: `picture` is not uint8, grey or BGR, or of another size than the first; nothing was started.
        """
        if self._follower is None:
            msg = "ECO was given a picture before it was told its target: call start with a picture and a box first"
            raise CompareError(msg)
        pyramid = Pyramid(grey(picture))
        if pyramid.size != self._follower.picture_size:
            width, height = self._follower.picture_size
            msg = "ECO started on pictures of {}x{} and was given one of {}x{}: start it anew".format(
                width, height, *pyramid.size
            )
            raise CompareError(msg)
        return self._follower.follow(pyramid)


class _Follower:
    """All that is known of one target."""

    def __init__(self, pyramid: Pyramid, box: Box, config: EcoConfig) -> None:
        self.picture_size = pyramid.size
        self._config = config
        self._center = box.center
        self._features = Features(box, config)
        self._scale = self._features.scale
        width, height = pyramid.size
        self._scale_range = (
            min(self._scale, SEARCH_SIDE_MIN_PX / self._features.side),
            self._scale * max(1.0, min(width / box.w, height / box.h)),
        )
        self._pictures = 1
        self._unlearnt = 0

        target, side = self._features.target, float(self._features.side)
        sigma = config.label_sigma * math.sqrt(target[0] * target[1]) / side
        label = label_spectrum(sigma, self._features.highest)
        window = PenaltyWindow(target, side, config)
        maps = self._features.maps(pyramid, self._center, self._scale)
        directions = self._features.principal_directions(maps)
        spectra = self._features.spectra(maps)
        filters, self._projections = learn_first(spectra, directions, label, window, config)
        sample = project_all(spectra, self._projections)
        self._space = SampleSpace(config.samples_max, config.learning_rate)
        self._space.add(sample)
        self._energy = sample_energy(sample)
        self._learner = FilterLearner(filters, label, window, config)
        self._scale_filter = ScaleFilter(target, config)
        self._scale_filter.learn(pyramid, self._center, self._target_size())

    def follow(self, pyramid: Pyramid) -> Answer:
        """Find the target in the next picture and learn from it."""
        maps = self._features.maps(pyramid, self._center, self._scale)
        projected = [project(part, projection) for part, projection in zip(maps, self._projections, strict=True)]
        sample = self._features.spectra(projected)
        peak = find_peak(
            filter_samples([part[None] for part in sample], self._learner.filters)[0], self._config.newton_steps
        )
        self._move(peak.column, peak.row)
        self._resize(self._scale_filter.find(pyramid, self._center, self._target_size()))
        self._learn(shifted(sample, peak.row, peak.column))
        self._scale_filter.learn(pyramid, self._center, self._target_size())
        width, height = self._target_size()
        box = Box(self._center[0] - width / 2, self._center[1] - height / 2, width, height)
        return Answer(box, float(np.clip(peak.score, 0, 1)))

    def _target_size(self) -> tuple[float, float]:
        width, height = self._features.target
        return width * self._scale, height * self._scale

    def _move(self, column: float, row: float) -> None:
        """Move the target by shares of the search area's side, within the picture."""
        extent = self._features.side * self._scale
        moved = []
        for place, shift, length, limit in zip(
            self._center, (column, row), self._target_size(), self.picture_size, strict=True
        ):
            outside = max(0.0, length / 2 - OVERLAP_MIN_PX)
            moved.append(min(max(place + shift * extent, -outside), limit + outside))
        self._center = moved[0], moved[1]

    def _resize(self, factor: float) -> None:
        smallest, largest = self._scale_range
        self._scale = min(max(self._scale * factor, smallest), largest)

    def _learn(self, sample: Spectra) -> None:
        """Add a sample with the target in its middle, and let the filter learn where it is time."""
        rate = np.float32(self._config.learning_rate)
        self._space.add(sample)
        self._energy = [
            (1 - rate) * mean + rate * new for mean, new in zip(self._energy, sample_energy(sample), strict=True)
        ]
        self._pictures += 1
        self._unlearnt += 1
        if self._pictures < self._config.train_each_until or self._unlearnt >= self._config.train_interval:
            self._learner.learn(self._space, self._energy)
            self._unlearnt = 0
