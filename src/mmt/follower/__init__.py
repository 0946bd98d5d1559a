"""The follower service: measure, stream, follow."""
