"""ROS 2: bags and live topics."""
