"""The MCAP files of recorded sessions: written, read and scanned."""
