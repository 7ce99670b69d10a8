"""The tracker of a node, which must not wait for recovery: neither for its network to load nor for an answer."""

from __future__ import annotations

from etd_ros.engine import make_tracker
from etd_ros.nodes.base import EtdNode
from etd_ros.recovery import network_is_there
from etd_ros.tracking import MultiTracker, method_named

NETWORK_WAIT_S = 5.0
"""Loading torch holds all of Python's threads up, half a second at a time: targets that start meanwhile are lost. So
nothing is read before it is done, unless that takes longer than this."""
SEARCH_WAIT_SHARE = 0.5
"""A lost target's answer from an image is waited for in this share of `queue_s`: rarely on a machine that keeps up.
Where it takes longer, messages would be dropped for it, and the targets that are seen lost with them."""


def check_tracker(node: EtdNode) -> None:
    """Make ready what the node's tracker needs.

    Raises:
        EtdError: no tracker can be made as the node's parameters say.
    """
    node_tracker(node, 1, 1)
    if not method_named(node.options.method).recovers or network_is_there(node.settings.recovery, NETWORK_WAIT_S):
        return
    node.get_logger().warning(
        f"recovery's network is still being loaded after {NETWORK_WAIT_S:g} s: what is lost before it is there is "
        "found on images only then"
    )


def node_tracker(node: EtdNode, width: int, height: int) -> MultiTracker:
    """A tracker for a sensor of a size (pixels), as the node's parameters say.

    Raises:
        EtdError: none can be made so.
    """
    options = node.options
    return make_tracker(
        options.method,
        width,
        height,
        node.settings,
        clicks=True,
        auto=options.auto,
        search_wait_s=SEARCH_WAIT_SHARE * options.queue_s,
    )
