"""What is asked of Siamese networks, and a thread of its own for each; without torch, which takes a second to
import."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from etd_ros.recovery.crops import Picture
from etd_ros.recovery.siamfc_tracking import Responses, SiamFcGeometry, SiamFcNetwork

Network = TypeVar("Network")
Crops = TypeVar("Crops")
Result = TypeVar("Result")


class Geometry(NamedTuple):
    """What crops a network takes.

    Attributes:
        exemplar_side: side of an exemplar's crop (pixels).
        margin: how far from a window's edge the first place is (pixels).
        window_pixels_max: of one search, for its time's sake.
    """

    exemplar_side: int
    margin: int
    window_pixels_max: int


COMPACT_GEOMETRY, SIAMRPN_GEOMETRY = Geometry(64, 24, 224 * 224), Geometry(127, 64, 272 * 272)


class Answers(NamedTuple):
    """What a network says about the places of a window.

    Attributes:
        scores: 0 to 1, of each template and then each distractor at each place, float32, shape (n, rows, columns); or
            of each of its anchors, shape (n, anchors, rows, columns).
        boxes: of the templates alone: centre x, y, width, height on the window (pixels), float32, shape (templates, 4,
            rows, columns) or (templates, 4, anchors, rows, columns).
    """

    scores: npt.NDArray[np.float32]
    boxes: npt.NDArray[np.float32]


class Matcher(Protocol):
    """A network for inference. Templates are what it makes of exemplars; targets and windows may share it."""

    geometry: Geometry

    def template(self, exemplar: Picture, size: tuple[float, float]) -> Any:
        """What is remembered of a crop with the target of a size (w, h; pixels of the crop) in its middle."""
        ...

    def match(self, window: Picture, templates: Sequence[Any], distractors: Sequence[Any] = ()) -> Answers:
        """Compare all places of a window, sides multiples of 8 pixels, with templates of targets and of distractors."""
        ...


class _Background(Generic[Network, Crops]):
    """A network that is loaded and run in one thread of its own; who asks before it is there waits for it.

    All inference happens in that thread, so that limits which torch keeps for each thread touch nobody else's.

    Args:
        geometry: of the network to come.
        load: makes it; called in the thread.
    """

    def __init__(self, geometry: Crops, load: Callable[[], Network]) -> None:
        self.geometry = geometry
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="recovery network")
        self._loading = self._thread.submit(load)

    def wait(self, timeout_s: float | None = None) -> bool:
        """Return once the network is there, or after so long (s); whether it is. Raises what its loading raised."""
        if not wait([self._loading], timeout_s).done:
            return False
        self._loading.result()
        return True

    def ask(self, question: Callable[[Network], Result]) -> Result:
        """The answer of the network; raises what the loading raised."""
        return self._thread.submit(lambda: question(self._loading.result())).result()


class BackgroundMatcher(_Background[Matcher, Geometry]):
    """A `Matcher` in a thread of its own."""

    def template(self, exemplar: Picture, size: tuple[float, float]) -> Any:
        """As `Matcher.template`; raises what the loading raised."""
        return self.ask(lambda matcher: matcher.template(exemplar, size))

    def match(self, window: Picture, templates: Sequence[Any], distractors: Sequence[Any] = ()) -> Answers:
        """As `Matcher.match`; raises what the loading raised."""
        return self.ask(lambda matcher: matcher.match(window, templates, distractors))


class BackgroundSiamFc(_Background[SiamFcNetwork, SiamFcGeometry]):
    """A `SiamFcNetwork` in a thread of its own."""

    def template(self, exemplar: Picture) -> Any:
        """As `SiamFcNetwork.template`; raises what the loading raised."""
        return self.ask(lambda network: network.template(exemplar))

    def responses(self, windows: Sequence[Picture], template: Any) -> Responses:
        """As `SiamFcNetwork.responses`; raises what the loading raised."""
        return self.ask(lambda network: network.responses(windows, template))
