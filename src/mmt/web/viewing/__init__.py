"""Recorded sessions on the monitor's page, with a slider for the time.

The model is built again from the recording, as the leader built it; all its states are kept on
disk. The page requests one moment after the other.
"""
