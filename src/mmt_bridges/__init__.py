"""Bridges to other programs: LeRobot, ROS 2, Lab Streaming Layer, HaTT, haptic files."""
