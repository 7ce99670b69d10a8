"""Reports say how targets were looked for, when they are asked to, and nothing else changes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from etd_ros.boxes import Box, iou
from etd_ros.detection import admissibility
from etd_ros.tracking import ContourConfig, MultiTracker, TargetState

WIDTH, HEIGHT = 240, 180
BOX = Box(60, 50, 40, 30)


def frames(count: int) -> list[np.ndarray]:
    """A square's outline that moves, and is gone in the end."""
    shown = []
    for step in range(count):
        outline = np.zeros((HEIGHT, WIDTH), np.uint8)
        x, y = int(BOX.x) + 2 * step, int(BOX.y) + step
        cv2.rectangle(outline, (x, y), (x + 39, y + 29), 255, 1)
        shown.append(np.repeat(outline[:, :, None], 2, axis=2))
    return [*shown, np.zeros((HEIGHT, WIDTH, 2), np.uint8)]


def run(*, searches: bool, contours: ContourConfig | None = None):
    tracker = MultiTracker(WIDTH, HEIGHT, contours=contours, searches=searches)
    tracker.start("now", BOX)
    tracker.start("later", BOX, 30_000_000)
    regions, reports = [], []
    for step, frame in enumerate(frames(5)):
        regions.append([target.search_region for target in tracker.targets.values()])
        reports.append(tracker.update(10_000_000 * (step + 1), frame))
    return regions, reports


@pytest.mark.parametrize(("contours", "moved_px"), [(None, 0), (ContourConfig(), 3)])
def test_the_region_is_the_one_before_the_frame_moved_on_by_contours_from_the_start_on(contours, moved_px):
    regions, reports = run(searches=True, contours=contours)
    for before, after in zip(regions, reports, strict=True):
        for region, report in zip(before, after, strict=True):
            if report.state is TargetState.IDLE:
                assert report.search is None
            else:
                assert report.search.region == pytest.approx(region, abs=moved_px)
    assert [reports[step][1].search is None for step in range(3)] == [True, True, False]


def test_the_candidates_are_admissible_and_the_chosen_box_is_among_them_best_first():
    _, reports = run(searches=True)
    last = BOX
    for report, _ in reports[:-1]:
        candidates = report.search.candidates
        assert (admissibility(candidates.boxes, last) > 0.7).all()
        assert iou(candidates.boxes, report.box).max() == 1
        assert (np.diff(candidates.scores) <= 0).all()
        last = report.box
    gone = reports[-1][0]
    assert gone.state is TargetState.LOST
    assert len(gone.search.candidates) == 0


@pytest.mark.parametrize("contours", [None, ContourConfig()])
def test_nothing_else_changes(contours):
    asked, not_asked = (run(searches=searches, contours=contours)[1] for searches in (True, False))
    assert asked == not_asked
    assert all(report.search is None for reports in not_asked for report in reports)
