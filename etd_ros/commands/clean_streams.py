"""A recording's streams as the converters get them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from etd_ros.conversion import BackgroundActivityFilter, NoiseFilterConfig
from etd_ros.stream import StreamBatch


def without_noise(batches: Iterable[StreamBatch], config: NoiseFilterConfig) -> Iterator[StreamBatch]:
    """The batches without what the noise filter removes; those of noise alone are left out, their restarts kept."""
    noise_filter: BackgroundActivityFilter | None = None
    size, restart = (0, 0), None
    for batch in batches:
        events = batch.events
        restart = batch.restart or restart
        if noise_filter is None or (events.width, events.height) != size:
            size = events.width, events.height
            noise_filter = BackgroundActivityFilter(*size, config)
        elif batch.restart is not None:
            noise_filter.reset()
        kept = noise_filter.filter(events)
        if len(kept):
            yield StreamBatch(kept, restart)
            restart = None
