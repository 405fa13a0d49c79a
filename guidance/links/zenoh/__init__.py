"""Zenoh: sessions and credentials, MAVLink and team messages over it, and ROS 2 nodes without ROS."""
