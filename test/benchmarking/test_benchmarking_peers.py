"""How the peers get their events; the peers themselves are not installed where the tests run."""

from etd_ros.benchmarking import peers
from etd_ros.benchmarking.streams import synthetic


def test_messages_are_cut_where_our_frames_end():
    messages = synthetic("uniform", 64, 48, 10, 1e6).messages(4)
    assert [len(events) for events in messages] == [4, 4, 2]
    pieces = peers._pieces(messages, [3, 8])
    assert pieces == [(0, 3, True), (3, 4, False), (4, 8, True), (8, 10, False)]
    assert peers._pieces(messages, []) == [(0, 4, False), (4, 8, False), (8, 10, False)]


def test_packages_that_are_missing_are_named_as_they_are_installed(monkeypatch):
    monkeypatch.setattr(peers, "PACKAGES", {"json": "json", "no_such_module": "no-such-module"})
    assert peers.missing_packages() == ["no-such-module"]


def test_peers_that_are_missing_give_no_subject(monkeypatch):
    monkeypatch.setattr(peers, "is_installed", lambda _: False)
    messages = synthetic("uniform", 64, 48, 10, 1e6).messages(4)
    assert peers.converters(messages, [5], all_peers=True) == []
    assert peers.readouts(messages[0]) == []
    assert peers.noise_filters(messages, 0.002) == []
    assert peers.evt3_message_decoders([b""], (64, 48), 1) == []
    with peers.evt3_block_decoders(b"", (64, 48), 1) as subjects:
        assert subjects == []
