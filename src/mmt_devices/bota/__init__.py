"""Force sensors by Bota Systems, on a serial line."""
