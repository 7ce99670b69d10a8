"""ROS 2 nodes, one module per executable."""
