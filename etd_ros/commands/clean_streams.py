"""A recording's streams as the converters get them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from etd_ros.conversion import BackgroundActivityFilter, NoiseFilterConfig
from etd_ros.per_sensor import PerSensor
from etd_ros.stream import StreamBatch


def without_noise(batches: Iterable[StreamBatch], config: NoiseFilterConfig) -> Iterator[StreamBatch]:
    """The batches without what the noise filter removes; those of noise alone are left out, their restarts kept."""
    filters = PerSensor(lambda width, height: BackgroundActivityFilter(width, height, config))
    restart = None
    for batch in batches:
        restart = batch.restart or restart
        kept = filters.at(batch).filter(batch.events)
        if len(kept):
            yield StreamBatch(kept, restart)
            restart = None
