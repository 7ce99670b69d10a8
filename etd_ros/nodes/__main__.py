"""`python -m etd_ros.nodes NAME`: a node as `ros2 run etd_ros NAME` starts it."""

import sys

from etd_ros.nodes.programs import NODES, start

if len(sys.argv) < 2 or sys.argv[1] not in NODES:
    print(f"etd_ros: name a node: python -m etd_ros.nodes {{{','.join(NODES)}}} ...", file=sys.stderr)  # noqa: T201
    sys.exit(2)
start(sys.argv.pop(1))
