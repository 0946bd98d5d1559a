"""What the system is worth: evaluations, measurements, reports."""
