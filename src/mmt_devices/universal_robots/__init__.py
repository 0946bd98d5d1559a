"""Arms by Universal Robots: the follower's robot, and its force sensor, by RTDE."""
