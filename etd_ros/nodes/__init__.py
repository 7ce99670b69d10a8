"""ROS 2 nodes, one module per executable."""

from etd_ros.kernel_cache import choose_kernel_cache

choose_kernel_cache()
