"""Logs of robots: bags of ROS 1 and 2, and MCAP."""
