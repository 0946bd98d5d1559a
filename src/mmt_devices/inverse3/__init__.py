"""The Haply Inverse3 through its service: the follower's robot, or the leader's handle."""
