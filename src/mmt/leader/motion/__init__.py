"""The hand's motion, who moves the robot, and force feedback."""
