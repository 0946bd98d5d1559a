"""Arms by Universal Robots through RTDE: the follower's robot, and its force sensor."""
