"""The hand's motion, control of the robot, and force feedback."""
