"""What is due now and then only is due as often as asked, whoever asks."""

from etd_ros.cadence import Cadence

MS = 1_000_000


def test_moments_are_due_as_often_as_asked():
    fast = Cadence(1 / 30)
    assert sum(fast.is_due(now_ns) for now_ns in range(0, 1000 * MS, MS)) == 30
    slow = Cadence(1 / 30)
    assert all(slow.is_due(now_ns) for now_ns in range(0, 1000 * MS, 50 * MS))


def test_without_an_interval_every_moment_is_due():
    assert all(map(Cadence(0.0).is_due, (5, 5, 6, 3)))


def test_who_begins_later_agrees_on_what_is_due():
    stamps = range(7 * MS, 1000 * MS, 3 * MS)
    early, late = Cadence(0.05), Cadence(0.05)
    due = [stamp_ns for stamp_ns in stamps if early.is_due(stamp_ns)]
    due_late = [stamp_ns for stamp_ns in stamps if stamp_ns > 400 * MS and late.is_due(stamp_ns)]
    assert due_late[1:] == [stamp_ns for stamp_ns in due if stamp_ns > due_late[0]]


def test_a_clock_that_goes_back_is_due_at_once():
    cadence = Cadence(1 / 30)
    assert cadence.is_due(10**12)
    assert cadence.is_due(0)
