"""Show recorded sessions on the monitor's page, with a slider for the time.

The model is rebuilt from the recording as the leader built it, and all its states are stored on
disk. The page requests one moment after the other.
"""
