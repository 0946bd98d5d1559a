"""The command lines: mmt, mmt-leader, mmt-follower."""
