"""`python -m etd_ros`."""

import sys

from etd_ros.cli import main

sys.exit(main())
