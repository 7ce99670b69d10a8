"""A rate that is measured now and then is believed by how well it was known before."""

from etd_ros.tracking.measured_rate import MeasuredRate

MS = 1_000_000


def test_a_rate_is_due_again_after_its_time():
    rate = MeasuredRate(0.02, 1.5, 1.6)
    assert [rate.is_due(stamp_ms * MS) for stamp_ms in (100, 110, 119, 120, 139, 141)] == [
        True, False, False, True, False, True,
    ]  # fmt: skip


def test_what_is_known_already_is_put_right_by_less():
    rate = MeasuredRate(0.02, 1.5, 1.6)
    gains = []
    for stamp_ms in (20, 40, 60, 1000):
        assert rate.is_due(stamp_ms * MS)
        gains.append(rate.gain(0.5, 0.01))
    assert gains[0] > gains[1] > gains[2]
    assert gains[3] > gains[2]


def test_a_measurement_that_errs_by_more_or_overlaps_the_last_one_counts_less():
    def gain(error, span_s):
        rate = MeasuredRate(0.02, 1.5, 1.6)
        assert rate.is_due(20 * MS)
        return rate.gain(error, span_s)

    assert gain(1.0, 0.01) < gain(0.5, 0.01)
    assert gain(0.5, 0.1) < gain(0.5, 0.01)
