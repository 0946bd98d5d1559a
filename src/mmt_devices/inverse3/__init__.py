"""The Haply Inverse3, by its service: a robot that follows, a handle that leads."""
