"""Recordings of other programs: columns of any name, unit and rate become frames at 1 kHz."""
