"""How edges move is told from when they came by, and growth from edges on opposite sides."""

import numpy as np
import pytest

from etd_ros.tracking.edge_flow import FLOWS_MIN, edge_flow, edge_flows
from etd_ros.tracking.edge_flow_kernels import COLUMNS, errors_by_edge, flows_of, motion_of
from etd_ros.tracking.surface import NEVER_NS

HEIGHT, WIDTH = 80, 100
NOW_NS = 1_000_000_000
EVERYWHERE = (0, HEIGHT, 0, WIDTH)
MIDDLE = (50.0, 40.0)


def times_of(came_by_s):
    """Last event times of the pixels that an edge reached, `came_by_s` (s, from now on backwards, nan: never)."""
    times = np.full((HEIGHT, WIDTH, 2), NEVER_NS, np.int64)
    reached = np.isfinite(came_by_s) & (came_by_s > 0)
    times[reached, 0] = NOW_NS - np.round(came_by_s[reached] * 1e9).astype(np.int64)
    return times


def pixels():
    """x and y of every pixel beside the middle, each of shape (HEIGHT, WIDTH)."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return columns + 0.5 - MIDDLE[0], rows + 0.5 - MIDDLE[1]


def line_going(angle_rad, speed_px_s, width_px=8.0):
    """An upright or slanted line that has come to the middle now."""
    x, y = pixels()
    way_px = -(np.cos(angle_rad) * x + np.sin(angle_rad) * y)
    return times_of(np.where((way_px > 0) & (way_px < width_px), way_px / speed_px_s, np.nan))


def outline(grows_per_s, velocity, radius_px=20.0, width_px=4.0):
    """A disc's outline that grows and moves, as it came by in the last pixels of its way (to first order)."""
    x, y = pixels()
    r = np.hypot(x, y)
    outward_px_s = grows_per_s * radius_px + (velocity[0] * x + velocity[1] * y) / np.maximum(r, 1e-9)
    age_s = (radius_px - r) / outward_px_s
    return times_of(np.where((age_s > 0) & (np.abs(radius_px - r) < width_px), age_s, np.nan))


@pytest.mark.parametrize("angle_rad", [0.0, 0.7, 2.0, -2.5])
def test_a_flow_has_its_edges_direction_and_speed(angle_rad):
    flows = np.empty((1000, COLUMNS))
    number = flows_of(line_going(angle_rad, 120.0), NOW_NS, NOW_NS - 200_000_000, *EVERYWHERE, *MIDDLE, flows)
    assert number > 100
    right, down, speed_px_s = np.median(flows[:number, :3], axis=0)
    assert (right, down) == pytest.approx((np.cos(angle_rad), np.sin(angle_rad)), abs=0.02)
    assert speed_px_s == pytest.approx(120.0, rel=0.02)


def test_of_many_event_pixels_those_all_over_the_window_are_taken():
    flows = np.empty((50, COLUMNS))
    number = flows_of(line_going(0.0, 120.0), NOW_NS, NOW_NS - 200_000_000, *EVERYWHERE, *MIDDLE, flows)
    assert 40 <= number <= 50
    assert np.ptp(flows[:number, 4]) > HEIGHT / 2


@pytest.mark.parametrize("grows_per_s", [-2.0, -0.5, 0.5, 2.0])
def test_what_grows_in_place_is_told_from_what_moves(grows_per_s):
    flow = edge_flow(outline(grows_per_s, (0.0, 0.0)), NOW_NS, 1.0, EVERYWHERE, *MIDDLE)
    assert flow.growing_per_s == pytest.approx(grows_per_s, rel=0.15)
    assert np.abs(flow.velocity).max() < 1.0
    assert abs(flow.growing_per_s) > 4 * flow.growing_error


def test_a_disc_that_moves_grows_by_nothing():
    flow = edge_flow(outline(0.0, (60.0, 30.0)), NOW_NS, 1.0, EVERYWHERE, *MIDDLE)
    assert flow.velocity == pytest.approx((60.0, 30.0), rel=0.1)
    assert abs(flow.growing_per_s) < 0.2


def test_both_together_are_taken_apart():
    flow = edge_flow(outline(1.5, (20.0, -10.0)), NOW_NS, 1.0, EVERYWHERE, *MIDDLE)
    assert flow.velocity == pytest.approx((20.0, -10.0), abs=3.0)
    assert flow.growing_per_s == pytest.approx(1.5, rel=0.15)


def spokes(turns_rad_s, number=5, width_rad=0.2):
    """Lines from the middle outwards that turn about it, clockwise as seen where the rate is above 0."""
    x, y = pixels()
    behind_rad = np.mod(-np.sign(turns_rad_s) * np.arctan2(y, x), 2 * np.pi / number)
    radius_px = np.hypot(x, y)
    is_near = (behind_rad > 0) & (behind_rad < width_rad) & (radius_px > 8) & (radius_px < 25)
    return times_of(np.where(is_near, behind_rad / abs(turns_rad_s), np.nan))


@pytest.mark.parametrize("turns_rad_s", [-6.0, -1.0, 1.0, 6.0])
def test_what_turns_in_place_is_told_from_what_moves(turns_rad_s):
    along, turning = edge_flows(spokes(turns_rad_s), NOW_NS, 1.0, EVERYWHERE, *MIDDLE)
    assert turning.turning_rad_s == pytest.approx(turns_rad_s, rel=0.1)
    assert abs(turning.turning_rad_s) > 6 * turning.turning_error
    assert np.abs(turning.velocity).max() < 2.0
    assert turning.spread_px_s < 0.3 * along.spread_px_s


def test_what_moves_along_and_grows_turns_by_nothing():
    along, turning = edge_flows(outline(1.5, (20.0, -10.0)), NOW_NS, 1.0, EVERYWHERE, *MIDDLE)
    assert abs(turning.turning_rad_s) < max(0.2, 6 * turning.turning_error)
    assert turning.growing_per_s == pytest.approx(1.5, rel=0.15)
    assert along.velocity == pytest.approx(turning.velocity, abs=3.0)


def test_a_single_edge_does_not_tell_growth_from_motion():
    flow = edge_flow(line_going(0.0, 100.0), NOW_NS, 1.0, (20, 60, 40, 60), 30.0, 40.0)
    assert flow.growing_error > 1.0 or abs(flow.growing_per_s) < 0.1


def test_edges_of_something_else_hardly_count():
    times = outline(1.5, (0.0, 0.0))
    beside = line_going(0.0, 30.0)
    times[:12] = beside[:12]
    flow = edge_flow(times, NOW_NS, 1.0, EVERYWHERE, *MIDDLE)
    assert flow.growing_per_s == pytest.approx(1.5, rel=0.2)


def test_few_edges_and_old_ones_tell_nothing():
    assert edge_flow(times_of(np.full((HEIGHT, WIDTH), np.nan)), NOW_NS, 1.0, EVERYWHERE, *MIDDLE) is None
    assert edge_flow(line_going(0.0, 120.0), NOW_NS, 0.001, EVERYWHERE, *MIDDLE) is None
    assert edge_flow(line_going(0.0, 120.0), NOW_NS, 1.0, (0, 2, 0, 100), *MIDDLE) is None


def test_what_came_everywhere_at_once_has_no_flow():
    times = np.full((HEIGHT, WIDTH, 2), NOW_NS - 1000, np.int64)
    flows = np.empty((100, COLUMNS))
    assert flows_of(times, NOW_NS, NOW_NS - 1_000_000, *EVERYWHERE, *MIDDLE, flows) == 0


@pytest.mark.parametrize("parts", [3, 4])
def test_the_motion_is_that_of_weighted_least_squares(parts):
    rng = np.random.default_rng(4)
    flows = np.empty((200, COLUMNS))
    angles = rng.uniform(0, 2 * np.pi, 200)
    flows[:, 0], flows[:, 1] = np.cos(angles), np.sin(angles)
    flows[:, 3:] = rng.uniform(-20, 20, (200, 2))
    around = flows[:, 1] * flows[:, 3] - flows[:, 0] * flows[:, 4]
    rows = np.column_stack([flows[:, 0], flows[:, 1], (flows[:, :2] * flows[:, 3:]).sum(axis=1), around])[:, :parts]
    flows[:, 2] = rows @ (30.0, -20.0, 1.2, -2.0)[:parts] + rng.normal(0, 2.0, 200)
    flows[:FLOWS_MIN, 2] += 500.0
    motion, error = np.zeros(parts), np.zeros(parts)
    spread_px_s = motion_of(flows, motion, error)
    expected, weights = np.zeros(parts), np.ones(200)
    for _ in range(8):
        weighted = rows * weights[:, None]
        expected = np.linalg.solve(weighted.T @ rows + 1e-9 * np.eye(parts), weighted.T @ flows[:, 2])
        strays = flows[:, 2] - rows @ expected
        weights = 1 / (1 + (strays / (2 * (1.4826 * np.median(np.abs(strays)) + 1e-6))) ** 2) ** 2
    assert motion == pytest.approx(expected, rel=1e-6)
    assert spread_px_s == pytest.approx(1.4826 * np.median(np.abs(strays)) + 1e-6, rel=1e-6)
    assert motion == pytest.approx((30.0, -20.0, 1.2, -2.0)[:parts], rel=0.05)
    assert (error > 0).all()
    assert np.abs(motion - (30.0, -20.0, 1.2, -2.0)[:parts]) == pytest.approx(0, abs=float(5 * error.max()))


def test_errors_by_edge_are_those_of_a_jackknife_over_edges():
    rng = np.random.default_rng(6)
    towards = rng.integers(0, 5, 200) * (2 * np.pi / 5) + 0.2
    normals = np.column_stack([np.cos(towards), np.sin(towards)])
    places = 10 * normals + rng.normal(0, 0.5, (200, 2))
    rows = np.column_stack([normals, (normals * places).sum(axis=1)])
    speeds_px_s = rows @ (0.0, 0.0, 4.0) + rng.normal(0, 1.0, 200) + 3.0 * (towards < 1)
    flows = np.column_stack([normals, speeds_px_s, places])
    motion, error, by_edge = np.zeros((3, 3))
    spread_px_s = motion_of(flows, motion, error)
    errors_by_edge(flows, motion, spread_px_s, by_edge)
    weights = 1 / (1 + ((speeds_px_s - rows @ motion) / (2 * spread_px_s)) ** 2) ** 2
    changes = []
    for angle in np.unique(towards):
        left = rows[towards != angle] * np.sqrt(weights[towards != angle, None])
        without, *_ = np.linalg.lstsq(left, speeds_px_s[towards != angle] * np.sqrt(weights[towards != angle]))
        changes.append(without - motion)
    assert by_edge == pytest.approx(np.sqrt(4 / 5 * np.square(changes).sum(axis=0)), rel=1e-4)
    assert (by_edge > 2 * error).all()


def test_growth_that_one_edge_of_three_decides_is_as_unsure_as_it_is_large():
    towards = np.repeat([0.3, 2.5, 4.4], 60)
    normals = np.column_stack([np.cos(towards), np.sin(towards)])
    speeds_px_s = normals @ (30.0, 10.0) + np.repeat([20.0, 0.0, 0.0], 60)
    noise_px_s, noise_px = np.random.default_rng(2).normal(0, 0.1, (2, 180))
    flows = np.column_stack([normals, speeds_px_s + noise_px_s, normals * (10 + noise_px[:, None])])
    motion, error, by_edge = np.zeros((3, 3))
    errors_by_edge(flows, motion, motion_of(flows, motion, error), by_edge)
    assert motion[2] > 100 * error[2]
    assert by_edge[2] > 0.5 * motion[2]
