"""Recorded sessions on the monitor's page, with a slider in the place of the clock.

The model is built again from the recording, as the leader built it; every state that it had
is kept on disk. The page asks for one moment after the other.
"""
