"""A LabJack U6: voltages at an even rate over USB."""
