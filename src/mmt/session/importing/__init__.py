"""Import recordings of other programs: convert columns of any name, unit and rate to frames."""
